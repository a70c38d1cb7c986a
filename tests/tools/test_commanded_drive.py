"""Commands reach the car and what it says reaches the pilot: no car, and the rover by bytes on a simulated clock."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.mavlink_rover import MavlinkRover
from drivers.mavlink_vehicle import MavlinkVehicle
from drivers.messages import LaserScan, Odometry
from drivers.rover_dynamics import RoverDynamics
from drivers.rover_faults import parse_rover_fault
from drivers.vehicle import DriveCommand, NullVehicle
from mapping import se2
from mapping.mount import Mount
from mapping.relocalisation import Located
from planning.safety import SafetyStage, Stamps
from tools.commanded_drive import CommandedDrive

AHEAD = DriveCommand(0.4, 0.5)
BRAKES_S = 0.1 + 0.4 / 1.5 + 0.02


def located(stamp_ns, pose=(0.0, 0.0, 0.0), correction=(0.0, 0.0, 0.0)):
    """A place whose odometry says `pose`, and the map another one by the correction."""
    correction = np.array(correction)
    return Located(stamp_ns, se2.compose(correction, np.array(pose)), correction, np.eye(3), 1.0, "")


class StraightOn:
    """Wants to drive one command for ever, through a real safety stage."""

    def __init__(self):
        self.safety = SafetyStage()
        self.place = None
        self.ticks = []

    def tick(self, now_s):
        self.ticks.append(now_s)
        return self.safety.step(AHEAD, Stamps(now_s, now_s, now_s), now_s)


class Bench:
    """A rover, the link to it, and the drive."""

    def __init__(self, *faults):
        self.clock = SimulatedClock(5_000_000_000)
        self.rover = MavlinkRover(RoverDynamics(np.zeros(3)), faults=[parse_rover_fault(fault) for fault in faults])
        self.rover.due(self.clock())
        self.wire = EmulatedLink(self.rover, self.clock, 115200, 115200)
        self.vehicle = MavlinkVehicle("rover", lambda: self.wire, self.clock)
        self.pilot = StraightOn()
        self.heard: list = []
        self.drive = CommandedDrive(self.pilot, self.vehicle, on_message=self.heard.append)

    def run(self, seconds):
        for _ in range(round(seconds / 0.05)):
            self.safe = self.drive.step(self.clock())
            self.clock.sleep(0.05)

    @property
    def speed_mps(self):
        self.rover.pass_time(self.clock())
        return self.rover.state.speed_mps


@pytest.fixture
def bench():
    found = Bench()
    with found.vehicle:
        yield found


def test_the_car_is_armed_when_the_place_is_known_and_stands_before(bench):
    bench.run(1.0)
    assert not bench.rover.autopilot.armed
    assert bench.safe.stopped
    assert "once the place is known" in bench.safe.reason
    bench.pilot.place = located(bench.clock())
    bench.run(2.0)
    assert bench.rover.autopilot.armed
    assert bench.speed_mps == pytest.approx(AHEAD.speed_mps)
    assert bench.rover.state.yaw_rate_radps == pytest.approx(AHEAD.yaw_rate_radps)
    assert (bench.safe.reason, bench.drive.fault) == ("", "")
    assert any(isinstance(message, Odometry) for message in bench.heard)


def test_no_car_takes_the_commands():
    clock, pilot = SimulatedClock(0), StraightOn()
    pilot.place = located(0)
    with NullVehicle(clock) as car:
        drive = CommandedDrive(pilot, car)
        for _ in range(40):
            drive.step(clock())
            clock.sleep(0.05)
        assert car.command == AHEAD
        pilot.safety.emergency_stop("pressed")
        drive.step(clock())
        assert car.command.speed_mps == 0.0
        assert not drive.state.ready or drive.step(clock()).stopped


def test_the_pilot_is_asked_at_its_period_however_often_the_car_is(bench):
    bench.pilot.place = located(bench.clock())
    began = bench.clock()
    while bench.clock() < began + 2_000_000_000:
        bench.drive.step(bench.clock())
        bench.clock.sleep(0.013)
    assert len(bench.pilot.ticks) == pytest.approx(40, abs=2)


def test_an_emergency_stop_disarms_and_stays(bench):
    bench.pilot.place = located(bench.clock())
    bench.run(2.0)
    bench.pilot.safety.emergency_stop("pressed")
    bench.run(0.05 + BRAKES_S)
    assert bench.speed_mps == 0.0
    assert not bench.rover.autopilot.armed
    bench.run(4.0)
    assert bench.speed_mps == 0.0
    assert bench.safe.reason == "emergency stop: pressed"


@pytest.mark.parametrize(
    ("fault", "words"), [("mode=MANUAL@4", "MANUAL: somebody else"), ("disarm@4", "disarmed itself")]
)
def test_who_takes_the_car_over_keeps_it(fault, words):
    bench = Bench(fault)
    with bench.vehicle:
        bench.pilot.place = located(bench.clock())
        bench.run(5.0)
        assert words in bench.safe.reason
        assert bench.drive.fault == ""
        sent = dict(bench.rover.received)
        bench.run(4.0)
        assert words in bench.drive.fault
        for kind in ("SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG"):
            assert bench.rover.received[kind] == sent[kind]
        assert (bench.safe.stopped, bench.rover.autopilot.armed) == (True, fault.startswith("mode"))


def test_a_refused_arm_is_tried_again_and_then_a_fault():
    bench = Bench("refuse-arm@0+6")
    with bench.vehicle:
        bench.pilot.place = located(bench.clock())
        bench.run(2.0)
        assert "PreArm" in bench.safe.reason
        bench.run(8.0)
        assert bench.speed_mps == pytest.approx(AHEAD.speed_mps)
    never = Bench("refuse-arm")
    with never.vehicle:
        never.pilot.place = located(never.clock())
        never.run(20.0)
        assert "PreArm" in never.drive.fault


def test_a_lost_vehicle_is_a_fault_and_stays_stopped_when_it_is_back():
    bench = Bench("silence@4+6")
    with bench.vehicle:
        bench.pilot.place = located(bench.clock())
        bench.run(8.0)
        assert "no heartbeat" in bench.drive.fault
        assert bench.speed_mps == 0.0
        bench.run(6.0)
        assert bench.speed_mps == 0.0
        assert not bench.rover.autopilot.armed


def test_a_pulled_plug_is_a_fault_and_the_pilot_knows_that_it_stands(bench):
    bench.pilot.place = located(bench.clock())
    bench.run(2.0)
    bench.wire.unplug()
    bench.run(0.1)
    assert bench.safe.stopped
    assert "unplugged" in bench.drive.fault


def test_pose_and_scan_are_told(bench):
    bench.pilot.place = located(bench.clock(), (1.0, 2.0, 0.5))
    scan = LaserScan(0, np.array([np.pi / 2.0]), np.array([1.0]), np.zeros(1), 0.15, 12.0)
    bench.drive.note_scan(scan)
    bench.run(0.3)
    assert bench.rover.received["ODOMETRY"] == 1
    assert bench.rover.last["ODOMETRY"].y == pytest.approx(-2.0)
    assert bench.rover.last["OBSTACLE_DISTANCE"].distances[54] == 100  # left is 270 deg clockwise
    bench.pilot.place = located(bench.clock(), (1.0, 2.0, 0.5), (0.5, 0.0, 0.0))
    bench.run(0.1)
    assert bench.rover.last["ODOMETRY"].reset_counter == 1


def test_a_laser_that_hangs_upside_down_is_mirrored_for_the_vehicle():
    clock, rover = SimulatedClock(5_000_000_000), MavlinkRover(RoverDynamics(np.zeros(3)))
    with MavlinkVehicle("rover", lambda: EmulatedLink(rover, clock, 115200, 115200), clock) as vehicle:
        drive = CommandedDrive(StraightOn(), vehicle, mount=Mount(np.zeros(3), inverted=True))
        drive.note_scan(LaserScan(0, np.array([np.pi / 2.0]), np.array([1.0]), np.zeros(1), 0.15, 12.0))
        drive.step(clock())
        assert rover.last["OBSTACLE_DISTANCE"].distances[18] == 100


def test_a_car_that_does_not_follow_is_stopped_for_good():
    """Its wheels turn, it says so, and it answers all: but it is not what it was told."""
    clock, pilot = SimulatedClock(5_000_000_000), StraightOn()
    stuck = RoverDynamics(np.zeros(3), fits=lambda _: False)  # a wall that no scan shows
    rover = MavlinkRover(stuck)
    with MavlinkVehicle("rover", lambda: EmulatedLink(rover, clock, 115200, 115200), clock) as vehicle:
        pilot.place = located(clock())
        drive = CommandedDrive(pilot, vehicle)
        for _ in range(60):
            drive.step(clock())
            clock.sleep(0.05)
    assert "does not follow: told 0.40 m/s" in drive.fault
    assert not rover.autopilot.armed


def test_a_fault_stops_the_car_in_the_step_that_finds_it():
    """No other step may come: the session may end just now."""
    clock, pilot = SimulatedClock(5_000_000_000), StraightOn()
    rover = MavlinkRover(RoverDynamics(np.zeros(3), fits=lambda _: False))
    link = EmulatedLink(rover, clock, 115200, 115200)
    with MavlinkVehicle("rover", lambda: link, clock) as vehicle:
        pilot.place = located(clock())
        drive = CommandedDrive(pilot, vehicle)
        while not drive.fault:
            drive.step(clock())
            clock.sleep(0.01)
        assert not rover.autopilot.armed
        assert not drive.left


def test_a_car_that_drives_on_after_an_emergency_stop_is_told_of():
    bench = Bench("deaf@4")
    with bench.vehicle:
        bench.pilot.place = located(bench.clock())
        while bench.clock() < 9_000_000_000:
            bench.run(0.05)
        bench.pilot.safety.emergency_stop("pressed")
        bench.run(2.0)
        assert "does not follow: told 0.00 m/s" in bench.drive.fault
        assert bench.safe.reason == "emergency stop: pressed"
