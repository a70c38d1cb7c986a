"""The numbers of MAVLink's common dialect and of ArduRover that the link uses; a test holds them against pymavlink's.

Sources: mavlink.io/en/messages/common.html; ArduPilot's Rover/mode.h for the modes.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class Component(IntEnum):
    """MAV_COMPONENT."""

    AUTOPILOT = 1
    ONBOARD_COMPUTER = 191


class VehicleType(IntEnum):
    """MAV_TYPE, as far as it is used."""

    GCS = 6
    GROUND_ROVER = 10
    ONBOARD_CONTROLLER = 18


class Autopilot(IntEnum):
    """MAV_AUTOPILOT, as far as it is used."""

    GENERIC = 0
    ARDUPILOT = 3
    INVALID = 8
    PX4 = 12


class ModeFlag(IntFlag):
    """MAV_MODE_FLAG, as far as it is used."""

    CUSTOM_MODE = 1
    GUIDED = 8
    MANUAL_INPUT = 64
    ARMED = 128


class SystemStatus(IntEnum):
    """MAV_STATE, as far as it is used."""

    STANDBY = 3
    ACTIVE = 4


class Command(IntEnum):
    """MAV_CMD, as far as it is used."""

    DO_SET_MODE = 176
    ARM_DISARM = 400
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512


class CommandResult(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


class Frame(IntEnum):
    """MAV_FRAME, as far as it is used: body axes are ahead, right, down."""

    LOCAL_NED = 1
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9
    BODY_FRD = 12
    LOCAL_FRD = 20


class Ignore(IntFlag):
    """POSITION_TARGET_TYPEMASK: what a setpoint does not say."""

    POSITION = 0x007
    VX = 0x008
    VY = 0x010
    VZ = 0x020
    ACCELERATION = 0x1C0
    YAW = 0x400
    YAW_RATE = 0x800


VELOCITY_AND_YAW_RATE = Ignore.POSITION | Ignore.VZ | Ignore.ACCELERATION | Ignore.YAW  # 1511, as ArduRover wants it

LIDAR_ESTIMATOR = 7  # MAV_ESTIMATOR_TYPE
LASER_SENSOR = 0  # MAV_DISTANCE_SENSOR
FLOAT_PARAMETER = 9  # MAV_PARAM_TYPE_REAL32


class RoverMode(IntEnum):
    """ArduRover's custom modes."""

    MANUAL = 0
    ACRO = 1
    STEERING = 3
    HOLD = 4
    LOITER = 5
    FOLLOW = 6
    SIMPLE = 7
    DOCK = 8
    CIRCLE = 9
    AUTO = 10
    RTL = 11
    SMART_RTL = 12
    GUIDED = 15
    INITIALISING = 16


# IDs of the messages that the link asks for.
SCALED_IMU, ATTITUDE, WHEEL_DISTANCE = 26, 30, 9000
