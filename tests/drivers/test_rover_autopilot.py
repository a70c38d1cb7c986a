"""What an ArduRover decides."""

import pytest

from drivers.mavlink_constants import RoverMode
from drivers.rover_autopilot import RoverAutopilot

S = 1_000_000_000


def guided(**parameters: float) -> RoverAutopilot:
    autopilot = RoverAutopilot(parameters)
    autopilot.set_mode(RoverMode.GUIDED)
    autopilot.set_armed(True)
    return autopilot


def test_a_setpoint_holds_for_three_seconds_and_leaves_the_steering() -> None:
    autopilot = guided()
    autopilot.set_target(0.5, 0.25, 10 * S)
    assert autopilot.command(13 * S).speed_mps == 0.5
    assert autopilot.command(13 * S).curvature_1pm == pytest.approx(0.5)
    stopped = autopilot.command(13 * S + S // 100)
    assert (stopped.speed_mps, stopped.curvature_1pm) == (0.0, 0.5)


@pytest.mark.parametrize(("mode", "armed"), [(RoverMode.HOLD, True), (RoverMode.GUIDED, False)])
def test_setpoints_are_heard_in_guided_and_armed_alone(mode: RoverMode, armed: bool) -> None:
    autopilot = guided()
    autopilot.set_mode(mode)
    autopilot.set_armed(armed)
    autopilot.set_target(0.5, 0.0, S)
    assert autopilot.command(S).speed_mps == 0.0


@pytest.mark.parametrize("change", [lambda a: a.set_mode(RoverMode.HOLD), lambda a: a.set_armed(False)])
def test_leaving_guided_or_disarming_stops(change) -> None:
    autopilot = guided()
    autopilot.set_target(0.5, 0.0, S)
    change(autopilot)
    assert autopilot.command(S).speed_mps == 0.0


@pytest.mark.parametrize("enabled", [False, True])
def test_heartbeat_failsafe_holds_where_it_is_on(enabled: bool) -> None:
    autopilot = guided(FS_GCS_ENABLE=float(enabled))
    autopilot.hear_station(255, S)
    autopilot.set_target(0.5, 0.0, 2 * S)
    autopilot.hear_station(1, 2 * S)  # another system's heartbeats do not count
    assert autopilot.command(2 * S + S // 4).speed_mps == 0.5
    assert autopilot.command(3 * S).speed_mps == (0.0 if enabled else 0.5)
    assert autopilot.mode == (RoverMode.HOLD if enabled else RoverMode.GUIDED)
