"""What a MAVLink vehicle tells: its state, its answers, its words, and odometry and IMU in ROS axes.

A function of messages and arrival stamps alone. The vehicle's ODOMETRY and LOCAL_POSITION_NED are left out: they come
from a filter that our own pose went into, so they would tell us what we told it.
"""

from __future__ import annotations

import logging
import math
import struct
from dataclasses import dataclass

import numpy as np

from drivers.mavlink_codec import MavlinkMessage
from drivers.mavlink_constants import FLOAT_PARAMETER, Autopilot, ModeFlag, VehicleType
from drivers.mavlink_frames import flipped_vector
from drivers.mavlink_modes import mode_name
from drivers.messages import Imu, Odometry

_GRAVITY_MPS2 = 9.80665
_NO_VEHICLES = (VehicleType.GCS, VehicleType.ONBOARD_CONTROLLER)
_FASTEST_MPS = 10.0  # a wheel that seems faster was counted anew
_OLDEST_YAW_NS = 300_000_000
_LATER_BY = 0.001  # the vehicle's clock may be slower than ours by this share
_WORDS_KEPT = 20
_SEVERITIES = {0: 50, 1: 50, 2: 50, 3: 40, 4: 30}  # MAV_SEVERITY to logging's levels, else info

log = logging.getLogger(__name__)


def is_vehicle(heartbeat: MavlinkMessage) -> bool:
    """Whether a HEARTBEAT comes from something that drives: ground stations, radios and cameras send them as well."""
    return heartbeat.autopilot != Autopilot.INVALID and heartbeat.type not in _NO_VEHICLES


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The last one of the vehicle."""

    stamp_ns: int
    autopilot: int
    armed: bool
    custom_mode: int

    @property
    def mode(self) -> str:
        """The mode's name."""
        return mode_name(self.autopilot, self.custom_mode)


class VehicleReport:
    """Takes the vehicle's messages; what they say is in its attributes, and in what take() returns.

    answers: last result of each command. parameters: by name. words: the last lines of STATUSTEXT, oldest first.
    """

    def __init__(self) -> None:
        self.heartbeat: Heartbeat | None = None
        self.heard_ns: int | None = None
        self.answers: dict[int, int] = {}
        self.parameters: dict[str, float] = {}
        self.words: list[str] = []
        self._begun: dict[int, str] = {}
        self._measured: list[Odometry | Imu] = []
        self._clocks: dict[str, _SenderClock] = {}
        self._yaw: tuple[int, float, float] | None = None  # arrival in ns, yaw in rad and its rate, ROS axes
        self._wheels = _WheelPath()
        self._imu_kind = ""

    def take(self) -> list[Odometry | Imu]:
        """Return what was measured since the last call, oldest first."""
        measured, self._measured = self._measured, []
        return measured

    def hear(self, message: MavlinkMessage, arrival_ns: int) -> None:
        """Take one message of the vehicle."""
        self.heard_ns = arrival_ns
        kind = message.get_type()
        if kind == "HEARTBEAT":
            if is_vehicle(message):
                armed = bool(message.base_mode & ModeFlag.ARMED)
                self.heartbeat = Heartbeat(arrival_ns, message.autopilot, armed, message.custom_mode)
        elif kind == "COMMAND_ACK":
            self.answers[message.command] = message.result
        elif kind == "PARAM_VALUE":
            self.parameters[message.param_id] = self._parameter(message)
        elif kind == "STATUSTEXT":
            self._say(message)
        elif kind == "NAMED_VALUE_FLOAT":
            log.debug("vehicle: %s %g", message.name, message.value)
        elif kind == "ATTITUDE":
            self._yaw = (arrival_ns, -message.yaw, -message.yawspeed)
        elif kind == "WHEEL_DISTANCE":
            self._roll(message, arrival_ns)
        elif kind in {"SCALED_IMU", "RAW_IMU", "HIGHRES_IMU"} and self._is_first_imu(kind):
            self._measured.append(self._imu(message, arrival_ns))

    def _parameter(self, message: MavlinkMessage) -> float:
        """PX4 puts the bytes of a whole number where the float is, ArduPilot its value."""
        heartbeat = self.heartbeat
        if message.param_type == FLOAT_PARAMETER or heartbeat is None or heartbeat.autopilot == Autopilot.ARDUPILOT:
            return float(message.param_value)
        return float(struct.unpack("<i", struct.pack("<f", message.param_value))[0])

    def _say(self, message: MavlinkMessage) -> None:
        """Long lines come in pieces of 50 characters under one id; the last is shorter."""
        text = self._begun.pop(message.id, "") + message.text
        if message.id and len(message.text) >= 50:
            self._begun[message.id] = text
            return
        self.words = [*self.words[1 - _WORDS_KEPT :], text]
        log.log(_SEVERITIES.get(message.severity, logging.INFO), "vehicle: %s", text)

    def _stamp_ns(self, kind: str, sent_ns: int, arrival_ns: int) -> int:
        return self._clocks.setdefault(kind, _SenderClock()).stamp_ns(sent_ns, arrival_ns)

    def _roll(self, message: MavlinkMessage, arrival_ns: int) -> None:
        if self._yaw is None or arrival_ns - self._yaw[0] > _OLDEST_YAW_NS or message.count < 1:
            return
        stamp_ns = self._stamp_ns("WHEEL_DISTANCE", message.time_usec * 1000, arrival_ns)
        _, yaw_rad, yaw_rate = self._yaw
        distance_m = sum(message.distance[: message.count]) / message.count
        odometry = self._wheels.roll(stamp_ns, distance_m, yaw_rad, yaw_rate)
        if odometry is not None:
            self._measured.append(odometry)

    def _is_first_imu(self, kind: str) -> bool:
        """ArduPilot sends the same sensor as RAW_IMU unasked, scaled as SCALED_IMU is; others send raw counts there."""
        if kind == "RAW_IMU" and (self.heartbeat is None or self.heartbeat.autopilot != Autopilot.ARDUPILOT):
            return False
        if self._imu_kind in {"", "RAW_IMU"}:
            self._imu_kind = kind
        return self._imu_kind == kind

    def _imu(self, message: MavlinkMessage, arrival_ns: int) -> Imu:
        turning = np.array([message.xgyro, message.ygyro, message.zgyro], dtype=np.float64)
        felt = np.array([message.xacc, message.yacc, message.zacc], dtype=np.float64)
        kind = message.get_type()
        sent_ns = message.time_boot_ms * 1_000_000 if kind == "SCALED_IMU" else message.time_usec * 1000
        if kind != "HIGHRES_IMU":  # thousandths of a radian a second and of gravity
            turning, felt = turning * 1e-3, felt * 1e-3 * _GRAVITY_MPS2
        return Imu(self._stamp_ns(kind, sent_ns, arrival_ns), flipped_vector(turning), flipped_vector(felt))


class _SenderClock:
    """Arrival stamps without most of the link's delays, by the sender's own stamps: the shortest delay seen counts."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._sent_ns = 0

    def stamp_ns(self, sent_ns: int, arrival_ns: int) -> int:
        offset_ns = arrival_ns - sent_ns
        since_ns = sent_ns - self._sent_ns
        self._sent_ns = sent_ns
        if self._offset_ns is None or since_ns < 0 or abs(offset_ns - self._offset_ns) > 1_000_000_000:
            self._offset_ns = offset_ns  # the first, or the sender began anew
        self._offset_ns = min(offset_ns, self._offset_ns + round(since_ns * _LATER_BY))
        return sent_ns + self._offset_ns


class _WheelPath:
    """The way that the wheels rolled, laid along the heading of the vehicle's gyroscope."""

    def __init__(self) -> None:
        self._last: tuple[int, float, float] | None = None
        self._place = (0.0, 0.0)

    def roll(self, stamp_ns: int, distance_m: float, yaw_rad: float, yaw_rate: float) -> Odometry | None:
        last, self._last = self._last, (stamp_ns, distance_m, yaw_rad)
        if last is None or not math.isfinite(distance_m + yaw_rad):
            return None
        seconds, way_m = (stamp_ns - last[0]) * 1e-9, distance_m - last[1]
        if seconds <= 0 or abs(way_m) > _FASTEST_MPS * seconds:
            return None
        middle = last[2] + math.remainder(yaw_rad - last[2], 2.0 * math.pi) / 2.0
        x_m, y_m = self._place
        self._place = x_m + way_m * math.cos(middle), y_m + way_m * math.sin(middle)
        pose = np.array([*self._place, math.remainder(yaw_rad, 2.0 * math.pi)])
        return Odometry(stamp_ns, pose, np.array([way_m / seconds, 0.0, yaw_rate]))
