"""Our link drives the emulated rover, byte by byte on a simulated clock; the rover's own state is the oracle."""

import numpy as np
import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import DeviceLostError, SilentPortError, WrongBaudError
from drivers.mavlink_rover import MavlinkRover
from drivers.mavlink_settings import MavlinkSettings
from drivers.mavlink_vehicle import MavlinkVehicle
from drivers.messages import Imu, LaserScan, Odometry
from drivers.rover_dynamics import RoverDynamics
from drivers.rover_faults import parse_rover_fault
from drivers.vehicle import (
    ArmingRefusedError,
    DriveCommand,
    LostVehicleError,
    VehicleLinkError,
    VehicleState,
    WrongModeError,
)

AHEAD = DriveCommand(0.5, -0.6)
BRAKES_S = 0.01 + 0.1 + 0.5 / 1.5  # a turn of the vehicle's loop, latency, and v / a


class Car:
    """A rover and our link to it."""

    def __init__(self, *faults: str, baud: int = 115200, **parameters: float) -> None:
        self.clock = SimulatedClock(5_000_000_000)
        self.rover = MavlinkRover(
            RoverDynamics(np.array([3.0, -1.0, 2.0])),
            faults=[parse_rover_fault(fault) for fault in faults],
            parameters=parameters,
        )
        self.rover.due(self.clock())
        self.wire = EmulatedLink(self.rover, self.clock, 115200, baud)
        self.vehicle = MavlinkVehicle("emulated rover", lambda: self.wire, self.clock)
        self.heard: list = []

    @property
    def speed_mps(self) -> float:
        self.rover.pass_time(self.clock())
        return self.rover.state.speed_mps

    def poll(self, seconds: float, command: DriveCommand | None = None) -> None:
        for _ in range(round(seconds / 0.05)):
            if command is not None:
                self.vehicle.drive(command)
            self.heard += self.vehicle.poll()
            self.clock.sleep(0.05)

    @property
    def state(self) -> VehicleState:
        return [message for message in self.heard if isinstance(message, VehicleState)][-1]


def test_drives_the_curve_that_was_commanded() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(3.0, AHEAD)
        state = car.rover.state
        assert state.speed_mps == pytest.approx(0.5)
        assert state.yaw_rate_radps == pytest.approx(AHEAD.yaw_rate_radps)
        assert car.state.ready
        car.poll(3.0, DriveCommand(-0.4, 0.5))
        assert car.rover.state.speed_mps == pytest.approx(-0.4)
        assert car.rover.state.yaw_rate_radps == pytest.approx(-0.2)


def test_what_the_vehicle_tells_of_itself() -> None:
    car = Car(GUID_TIMEOUT=1.5, FS_GCS_ENABLE=1.0)
    with car.vehicle as vehicle:
        assert vehicle.setpoint_timeout_s == 1.5
        assert len(vehicle.warnings) == 2
        assert vehicle.parameters["FS_GCS_ENABLE"] == 1.0
    as_delivered = Car()
    with as_delivered.vehicle as vehicle:
        assert vehicle.setpoint_timeout_s == 3.0


def test_odometry_and_imu_come_in() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(4.0, AHEAD)
    odometry = [message for message in car.heard if isinstance(message, Odometry)]
    imu = [message for message in car.heard if isinstance(message, Imu)]
    assert len(odometry) > 70
    assert len(imu) > 70
    assert odometry[-1].pose[2] < -0.8  # turned right
    assert imu[-1].angular_velocity_radps[2] == pytest.approx(AHEAD.yaw_rate_radps, abs=0.01)
    assert np.all(np.diff([message.stamp_ns for message in odometry]) > 0)


def test_a_command_is_repeated_for_half_a_second_and_then_standstill() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(1.0, AHEAD)
        car.poll(0.4)
        assert car.speed_mps == pytest.approx(0.5)
        car.poll(0.2 + BRAKES_S)
        assert car.speed_mps == 0.0
        assert car.state.ready


def test_a_stuck_process_is_stopped_by_the_vehicle() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(1.0, AHEAD)
        car.clock.sleep(2.8)
        assert car.speed_mps == pytest.approx(0.5)
        car.clock.sleep(0.3 + BRAKES_S)
        assert car.speed_mps == 0.0


def test_stop_stands_and_holds_until_armed_again() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(1.0, AHEAD)
        vehicle.stop()
        car.poll(BRAKES_S + 0.05, AHEAD)
        assert (car.speed_mps, car.rover.autopilot.mode.name, car.state.ready) == (0.0, "HOLD", False)
        vehicle.arm()
        car.poll(1.0, AHEAD)
        assert car.speed_mps == pytest.approx(0.5)


def test_leaving_the_context_stops_the_car_also_after_an_error() -> None:
    car = Car()

    def drive() -> None:
        with car.vehicle as vehicle:
            vehicle.arm()
            car.poll(1.0, AHEAD)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        drive()
    assert car.wire.closed
    assert car.rover.autopilot.mode.name == "HOLD"
    car.clock.sleep(BRAKES_S)
    assert car.speed_mps == 0.0
    with pytest.raises(VehicleLinkError, match="not connected"):
        car.vehicle.poll()


def test_emergency_stop_is_latched_and_disarms() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(1.0, AHEAD)
        vehicle.emergency_stop()
        car.poll(BRAKES_S + 0.05, AHEAD)
        assert car.speed_mps == 0.0
        assert not car.rover.autopilot.armed
        assert (car.state.ready, car.state.reason) == (False, "emergency stop: arm again")
        vehicle.arm()
        car.poll(1.0, AHEAD)
        assert car.speed_mps == pytest.approx(0.5)


def test_emergency_stop_insists_where_the_vehicle_hears_late() -> None:
    car = Car("deaf@3+0.5")
    with car.vehicle as vehicle:
        vehicle.arm()
        while car.clock() < 8_100_000_000:
            car.poll(0.05, AHEAD)
        vehicle.emergency_stop()
        car.poll(0.2)
        assert car.rover.autopilot.armed
        car.poll(1.0)
        assert not car.rover.autopilot.armed


def test_a_lost_link_is_told_stands_locally_and_needs_arming_again() -> None:
    car = Car("silence@3+6")  # still hears: only our own standstill stops it
    with car.vehicle as vehicle:
        vehicle.arm()
        with pytest.raises(LostVehicleError, match="no heartbeat"):
            car.poll(6.0, AHEAD)
        lost_s = car.clock() * 1e-9 - 8.0
        assert lost_s < 3.1
        with pytest.raises(LostVehicleError):
            vehicle.arm()
        car.clock.sleep(BRAKES_S)
        assert car.speed_mps == 0.0
        car.clock.sleep(5.5)
        car.poll(0.5, AHEAD)
        assert car.speed_mps == 0.0
        assert "arm again" in car.state.reason
        vehicle.arm()
        car.poll(1.0, AHEAD)
        assert car.speed_mps == pytest.approx(0.5)


def test_a_cut_link_is_stopped_by_the_vehicles_own_timeout() -> None:
    car = Car("cut@4")
    with car.vehicle as vehicle:
        vehicle.arm()
        with pytest.raises(LostVehicleError):
            car.poll(9.0, AHEAD)
        car.clock.now_ns = 9_000_000_000 + round((3.0 + BRAKES_S + 0.05) * 1e9)
        assert car.speed_mps == 0.0


def test_a_vehicle_that_does_not_hear_is_noticed_though_its_heartbeats_come() -> None:
    car = Car("deaf@4")
    with car.vehicle as vehicle:
        vehicle.arm()
        while car.clock() < 9_000_000_000:
            car.poll(0.05, AHEAD)
        assert car.state.ready
        car.poll(0.6, AHEAD)
        assert not car.state.ready
        assert "not hear us" in car.state.reason
        with pytest.raises(LostVehicleError, match="does not hear us"):
            car.poll(3.0, AHEAD)
        assert car.clock() < 11_700_000_000


def test_a_vehicle_that_does_not_answer_for_a_moment_is_told_to_stand_and_drives_on() -> None:
    car = Car("silence@4+1")
    with car.vehicle as vehicle:
        vehicle.arm()
        while car.clock() < 9_000_000_000:
            car.poll(0.05, AHEAD)
        car.poll(0.6, AHEAD)
        car.poll(0.4, AHEAD)
        assert car.speed_mps < 0.1
        car.poll(2.0, AHEAD)
        assert car.state.ready
        assert car.speed_mps == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("fault", "words"), [("mode=MANUAL@3", "MANUAL: somebody else"), ("disarm@3", "disarmed itself")]
)
def test_who_takes_the_car_over_keeps_it(fault: str, words: str) -> None:
    car = Car(fault)
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(5.0, AHEAD)
        assert not car.state.ready
        assert words in car.state.reason
        before = car.rover.received["SET_POSITION_TARGET_LOCAL_NED"]
        car.poll(2.0, AHEAD)
        assert car.rover.received["SET_POSITION_TARGET_LOCAL_NED"] == before


def test_refused_arm_says_why() -> None:
    with Car("refuse-arm").vehicle as vehicle, pytest.raises(ArmingRefusedError, match="PreArm: refused"):
        vehicle.arm()


def test_a_vehicle_that_keeps_its_mode_is_told() -> None:
    car = Car("deaf@2")
    car.vehicle.settings = MavlinkSettings(lost_after_s=20.0)
    with car.vehicle as vehicle:
        car.clock.sleep(1.0)
        car.poll(0.1)
        with pytest.raises(WrongModeError, match="stays in MANUAL instead of GUIDED"):
            vehicle.arm()


def test_nobody_there_and_the_wrong_speed() -> None:
    with pytest.raises(SilentPortError, match="nothing arrives"), Car("cut").vehicle:
        pass
    with pytest.raises(WrongBaudError, match="no MAVLink"), Car(baud=57600).vehicle:
        pass


def test_a_pulled_plug_is_a_device_error() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.wire.unplug()
        with pytest.raises(DeviceLostError):
            vehicle.poll()


def test_pose_and_obstacles_reach_the_vehicle() -> None:
    car = Car()
    with car.vehicle as vehicle:
        pose, still = np.array([1.0, 2.0, 0.5]), np.zeros(3)
        vehicle.tell_pose(0, pose, still)
        vehicle.tell_pose(0, pose, still, jumped=True)
        vehicle.tell_scan(LaserScan(0, np.array([0.0]), np.array([1.0]), still[:1], 0.15, 12.0), still)
    assert car.rover.received["SET_GPS_GLOBAL_ORIGIN"] == 1
    assert car.rover.received["ODOMETRY"] == 2
    assert car.rover.last["ODOMETRY"].reset_counter == 1
    assert car.rover.last["ODOMETRY"].y == -2.0
    assert car.rover.last["OBSTACLE_DISTANCE"].distances[0] == 100
