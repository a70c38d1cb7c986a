"""Asking the emulated rover on a simulated clock; what whole drives make of it is in test_mavlink_vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import SilentPortError
from drivers.mavlink_constants import Command
from drivers.mavlink_dialogue import Dialogue
from drivers.mavlink_link import MavlinkLink
from drivers.mavlink_rover import MavlinkRover
from drivers.mavlink_settings import MavlinkSettings
from drivers.rover_dynamics import RoverDynamics
from drivers.rover_faults import parse_rover_fault
from drivers.vehicle import LostVehicleError


class Bench:
    def __init__(self, *faults: str, **parameters: float) -> None:
        self.clock, self.waited = SimulatedClock(1_000_000_000), 0
        found = [parse_rover_fault(fault) for fault in faults]
        self.rover = MavlinkRover(RoverDynamics(np.zeros(3)), faults=found, parameters=parameters)
        link = MavlinkLink(EmulatedLink(self.rover, self.clock, 115200, 115200), self.clock)
        self.talk = Dialogue("rover", link, self.clock, MavlinkSettings(), self.meanwhile)

    def meanwhile(self) -> None:
        self.waited += 1

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.talk.hear()
            self.clock.sleep(0.05)


def test_parameters_are_asked_for_and_the_timeout_is_among_them() -> None:
    bench = Bench(GUID_TIMEOUT=1.25)
    bench.talk.await_vehicle()
    assert bench.talk.setpoint_timeout_s == 3.0  # ArduRover's own, until it is told
    bench.talk.read_parameters()
    assert bench.talk.setpoint_timeout_s == 1.25


def test_a_command_is_done_when_its_effect_is_seen() -> None:
    bench = Bench()
    bench.talk.await_vehicle()
    assert (bench.talk.mode, bench.talk.is_guided(), bench.talk.is_armed()) == ("MANUAL", False, False)
    assert bench.talk.ask(Command.DO_SET_MODE, bench.talk.is_guided, 1.0, *bench.talk.modes.guided)
    assert bench.talk.ask(Command.ARM_DISARM, bench.talk.is_armed, 1.0)
    assert bench.rover.autopilot.armed
    assert bench.waited > 0


def test_a_refusal_is_told_in_the_vehicles_words() -> None:
    bench = Bench("refuse-arm")
    bench.talk.await_vehicle()
    assert not bench.talk.ask(Command.ARM_DISARM, bench.talk.is_armed, 1.0)
    assert bench.talk.answer(Command.ARM_DISARM).startswith(" (FAILED), it says: PreArm")


@pytest.mark.parametrize(("fault", "words"), [("silence@2", "no heartbeat"), ("deaf@2", "does not hear us")])
def test_a_vehicle_that_is_silent_or_deaf_is_lost_after_its_time(fault: str, words: str) -> None:
    bench = Bench(fault)
    bench.talk.await_vehicle()
    bench.run(3.0)
    bench.talk.check_heard()
    assert bench.talk.unanswered_s > 0.5
    bench.run(2.6)
    with pytest.raises(LostVehicleError, match=words):
        bench.talk.check_heard()


def test_a_vehicle_that_answers_is_never_called_deaf() -> None:
    bench = Bench()
    bench.talk.await_vehicle()
    bench.run(5.0)
    bench.clock.sleep(5.0)  # our process was stuck
    bench.run(0.2)
    assert bench.talk.unanswered_s < 0.3
    bench.talk.check_heard()


def test_nobody_there() -> None:
    with pytest.raises(SilentPortError, match="nothing arrives in 5 s"):
        Bench("cut").talk.await_vehicle()
