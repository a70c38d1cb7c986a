"""The emulated rover answers as an ArduRover does, seen by plain MAVLink."""

import numpy as np
import pytest

from drivers.mavlink_codec import MavlinkCodec
from drivers.mavlink_rover import MavlinkRover
from drivers.rover_dynamics import NoisyOdometry, RoverDynamics
from drivers.rover_faults import parse_rover_fault

S = 1_000_000_000


class Station:
    """Sends and reads plain messages."""

    def __init__(self, *faults: str, **parameters: float) -> None:
        exact = NoisyOdometry(seed=0, way_noise_m=0.0, turn_noise_rad=0.0)
        self.rover = MavlinkRover(
            RoverDynamics(np.array([5.0, 1.0, 0.0])),
            odometry=exact,
            faults=[parse_rover_fault(fault) for fault in faults],
            parameters=parameters,
        )
        self.codec = MavlinkCodec(255, 190)
        self.now_ns = 0
        self.rover.due(0)

    def send(self, name: str, /, **fields):
        target = {} if name == "HEARTBEAT" else {"target_system": 1, "target_component": 1}
        return self.codec.decode(self.rover.receive(self.codec.encode(name, **target, **fields), self.now_ns))

    def command(self, command: int, *values: float):
        parameters = {f"param{k + 1}": (*values, *[0.0] * 7)[k] for k in range(7)}
        return self.send("COMMAND_LONG", command=command, confirmation=0, **parameters)

    def setpoint(self, mask: int = 1511, frame: int = 8, **fields: float) -> None:
        names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        values = {name: fields.get(name, 0.0) for name in names}
        self.send("SET_POSITION_TARGET_LOCAL_NED", time_boot_ms=0, coordinate_frame=frame, type_mask=mask, **values)

    def let_pass(self, seconds: float):
        heard = []
        for _ in range(round(seconds / 0.05)):
            self.now_ns += S // 20
            heard += self.codec.decode(self.rover.due(self.now_ns))
        return heard

    def ready(self) -> "Station":
        assert self.command(176, 1.0, 15.0)[0].result == 0
        assert self.command(400, 1.0)[0].result == 0
        return self


def test_a_heartbeat_a_second_and_the_mode_in_it() -> None:
    station = Station()
    beats = [message for message in station.let_pass(5.0) if message.get_type() == "HEARTBEAT"]
    assert len(beats) == 5
    assert (beats[0].type, beats[0].autopilot, beats[0].custom_mode, beats[0].base_mode & 128) == (10, 3, 0, 0)
    station.ready()
    (beat, *_) = station.let_pass(0.05)
    assert (beat.custom_mode, beat.base_mode & 128) == (15, 128)


def test_positive_yaw_rate_turns_right() -> None:
    station = Station().ready()
    for _ in range(20):
        station.setpoint(vx=0.5, yaw_rate=0.25)
        station.let_pass(0.1)
    state = station.rover.state
    assert state.speed_mps == pytest.approx(0.5)
    assert state.yaw_rate_radps == pytest.approx(-0.25)
    assert state.pose[0] > 5.5
    assert state.pose[1] < 1.0


def test_stops_three_seconds_after_the_last_setpoint() -> None:
    station = Station().ready()
    station.setpoint(vx=0.5)
    station.let_pass(3.0)
    assert station.rover.state.speed_mps == pytest.approx(0.5)
    station.let_pass(0.1 + 0.1 + 0.5 / 1.5)
    assert station.rover.state.speed_mps == 0.0


@pytest.mark.parametrize(
    ("mask", "frame", "moves"),
    [(1511, 8, True), (1511, 9, True), (1479, 8, True), (3580, 8, False), (1511, 1, False), (1535, 8, False)],
)
def test_masks_and_frames(mask: int, frame: int, moves: bool) -> None:
    station = Station().ready()
    station.setpoint(mask, frame, vx=0.5, x=3.0)
    station.let_pass(1.0)
    assert (station.rover.state.speed_mps > 0) == moves


def test_parameters_are_read_listed_and_set() -> None:
    station = Station(GUID_TIMEOUT=1.0)
    (answer,) = station.send("PARAM_REQUEST_READ", param_id=b"GUID_TIMEOUT", param_index=-1)
    assert (answer.param_id, answer.param_value) == ("GUID_TIMEOUT", 1.0)
    assert station.send("PARAM_REQUEST_READ", param_id=b"NO_SUCH", param_index=-1) == []
    listed = station.send("PARAM_REQUEST_LIST")
    assert len(listed) == listed[0].param_count == len({message.param_index for message in listed})
    (answer,) = station.send("PARAM_SET", param_id=b"FS_GCS_ENABLE", param_value=1.0, param_type=9)
    assert answer.param_value == 1.0
    assert station.rover.autopilot.parameters["FS_GCS_ENABLE"] == 1.0


def test_telemetry_comes_as_asked_for_and_tells_the_way() -> None:
    station = Station().ready()
    for message in (30, 9000, 26):
        assert station.command(511, message, 50_000)[0].result == 0
    assert station.command(511, 33, 50_000)[0].result != 0
    station.setpoint(vx=0.5, yaw_rate=-0.25)
    heard = station.let_pass(2.0)
    by_kind = {
        kind: [m for m in heard if m.get_type() == kind] for kind in ("ATTITUDE", "WHEEL_DISTANCE", "SCALED_IMU")
    }
    assert [len(messages) for messages in by_kind.values()] == [40, 40, 40]
    turned = station.rover.state.pose[2]
    assert by_kind["ATTITUDE"][-1].yaw == pytest.approx(-turned, abs=1e-6)
    assert by_kind["WHEEL_DISTANCE"][-1].distance[0] == pytest.approx(turned / 0.5, abs=0.02)
    assert by_kind["SCALED_IMU"][-1].zgyro == -250
    assert by_kind["SCALED_IMU"][-1].yacc == round(-0.125 / 9.80665 * 1000)  # thrown to the right: pushed left


def test_refused_arm_is_told_in_words() -> None:
    station = Station("refuse-arm@0+5")
    acknowledged, words = station.command(400, 1.0)
    assert acknowledged.result == 4
    assert words.text.startswith("PreArm")
    station.let_pass(5.0)
    assert station.command(400, 1.0)[0].result == 0


def test_silent_deaf_and_cut() -> None:
    silent, deaf, cut = Station("silence@1"), Station("deaf@1"), Station("cut@1")
    heard = {name: station.let_pass(3.0) for name, station in (("silent", silent), ("deaf", deaf), ("cut", cut))}
    beats = {name: sum(m.get_type() == "HEARTBEAT" for m in messages) for name, messages in heard.items()}
    assert beats["deaf"] == 3
    assert beats["silent"] == beats["cut"] < 2
    for station in (silent, deaf, cut):
        assert station.command(400, 1.0) == []
    assert [station.rover.autopilot.armed for station in (silent, deaf, cut)] == [True, False, False]


def test_somebody_changes_the_mode_or_it_disarms_itself() -> None:
    taken, dropped = Station("mode=MANUAL@2").ready(), Station("disarm@2").ready()
    for station in (taken, dropped):
        for _ in range(50):
            station.setpoint(vx=0.5)
            station.let_pass(0.05)
        assert station.rover.state.speed_mps < 0.5
    assert taken.rover.autopilot.mode.name == "MANUAL"
    assert not dropped.rover.autopilot.armed


def test_others_orders_and_unknown_ones() -> None:
    station = Station()
    foreign = station.codec.encode(
        "COMMAND_LONG",
        target_system=9,
        target_component=1,
        command=400,
        confirmation=0,
        param1=1.0,
        **{f"param{k}": 0.0 for k in range(2, 8)},
    )
    assert station.rover.receive(foreign, 0) == b""
    assert station.command(22)[0].result == 3
    assert station.command(176, 1.0, 99.0)[0].result == 4
    assert station.command(512, 148.0)[1].get_type() == "AUTOPILOT_VERSION"
