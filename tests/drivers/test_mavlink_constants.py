"""Our numbers are pymavlink's."""

import pytest

from drivers import mavlink_constants as ours

pymavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")

NAMES = {
    "COMP_ID_AUTOPILOT1": ours.Component.AUTOPILOT,
    "COMP_ID_ONBOARD_COMPUTER": ours.Component.ONBOARD_COMPUTER,
    "AUTOPILOT_ARDUPILOTMEGA": ours.Autopilot.ARDUPILOT,
    "MODE_FLAG_CUSTOM_MODE_ENABLED": ours.ModeFlag.CUSTOM_MODE,
    "MODE_FLAG_GUIDED_ENABLED": ours.ModeFlag.GUIDED,
    "MODE_FLAG_MANUAL_INPUT_ENABLED": ours.ModeFlag.MANUAL_INPUT,
    "MODE_FLAG_SAFETY_ARMED": ours.ModeFlag.ARMED,
    "CMD_COMPONENT_ARM_DISARM": ours.Command.ARM_DISARM,
    "ESTIMATOR_TYPE_LIDAR": ours.LIDAR_ESTIMATOR,
    "DISTANCE_SENSOR_LASER": ours.LASER_SENSOR,
    "PARAM_TYPE_REAL32": ours.FLOAT_PARAMETER,
}
PREFIXES = {
    ours.VehicleType: "MAV_TYPE_",
    ours.Autopilot: "MAV_AUTOPILOT_",
    ours.SystemStatus: "MAV_STATE_",
    ours.Command: "MAV_CMD_",
    ours.CommandResult: "MAV_RESULT_",
    ours.Frame: "MAV_FRAME_",
    ours.RoverMode: "ROVER_MODE_",
}


@pytest.mark.parametrize("name", NAMES)
def test_named_number(name: str) -> None:
    assert getattr(pymavlink, f"MAV_{name}") == NAMES[name]


@pytest.mark.parametrize("kind", PREFIXES)
def test_enumeration(kind) -> None:
    found = {name: getattr(pymavlink, PREFIXES[kind] + name, None) for name in kind.__members__}
    known = {name: value for name, value in found.items() if value is not None}
    assert len(known) >= len(found) - 2  # ArduPilot's own names of two differ from the message definitions'
    assert known == {name: kind[name].value for name in known}


def test_masks() -> None:
    assert ours.Ignore.YAW_RATE == pymavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
    assert ours.Ignore.YAW == pymavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    assert ours.Ignore.VX == pymavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    assert ours.VELOCITY_AND_YAW_RATE == 1511  # ArduPilot's documentation: "Use Velocity + Yaw Rate"


def test_messages_that_are_asked_for() -> None:
    names = ("SCALED_IMU", "ATTITUDE", "WHEEL_DISTANCE")
    assert [getattr(pymavlink, f"MAVLINK_MSG_ID_{name}") for name in names] == [getattr(ours, name) for name in names]
