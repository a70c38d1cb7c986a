"""What ArduRover decides, without MAVLink and motors: modes, arming, setpoints that time out, the heartbeat failsafe.

After ArduPilot's Rover/mode_guided.cpp and failsafe.cpp, idealised: what is asked for is what the wheels are told.
"""

from __future__ import annotations

from drivers.mavlink_constants import RoverMode
from drivers.vehicle import STANDSTILL, DriveCommand

# Names and defaults of ArduRover's; those that matter to the link.
PARAMETERS: dict[str, float] = {
    "ARMING_CHECK": 1.0,
    "FENCE_ENABLE": 0.0,
    "FS_ACTION": 2.0,
    "FS_CRASH_CHECK": 0.0,
    "FS_GCS_ENABLE": 0.0,
    "FS_TIMEOUT": 1.5,
    "GUID_TIMEOUT": 3.0,
    "SYSID_MYGCS": 255.0,
    "SYSID_THISMAV": 1.0,
}
_LEAST_SPEED_MPS = 0.01  # slower, a yaw rate says nothing about the steering


class RoverAutopilot:
    """Times are ns of any clock. parameters: may be changed at any time."""

    def __init__(self, parameters: dict[str, float] | None = None) -> None:
        self.parameters = {**PARAMETERS, **(parameters or {})}
        self.mode = RoverMode.MANUAL
        self.armed = False
        self.failed_safe = False
        self._target = STANDSTILL
        self._target_ns: int | None = None
        self._station_ns: int | None = None

    def set_mode(self, mode: RoverMode) -> None:
        """Change the mode; GUIDED begins at standstill."""
        if mode != self.mode:
            self.mode = mode
            self._target, self._target_ns = self._standing(), None

    def set_armed(self, armed: bool) -> None:
        """Arm or disarm; a disarmed car rolls out with its brakes on."""
        self.armed = armed
        if not armed:
            self._target, self._target_ns = self._standing(), None

    def hear_station(self, system: int, now_ns: int) -> None:
        """Take a heartbeat of a ground station or companion."""
        if system == int(self.parameters["SYSID_MYGCS"]):
            self._station_ns = now_ns
            self.failed_safe = False

    def set_target(self, speed_mps: float, yaw_rate_radps: float, now_ns: int) -> None:
        """Take a setpoint in ROS axes; heard only in GUIDED and armed. At standstill the steering stays."""
        if self.mode != RoverMode.GUIDED or not self.armed:
            return
        moves = abs(speed_mps) > _LEAST_SPEED_MPS
        curvature = yaw_rate_radps / speed_mps if moves else self._target.curvature_1pm
        self._target, self._target_ns = DriveCommand(speed_mps, curvature), now_ns

    def command(self, now_ns: int) -> DriveCommand:
        """Return what the wheels are told now."""
        self._check_station(now_ns)
        age_s = 0.0 if self._target_ns is None else (now_ns - self._target_ns) * 1e-9
        if age_s > self.parameters["GUID_TIMEOUT"]:
            self._target, self._target_ns = self._standing(), None
        return self._target

    def _check_station(self, now_ns: int) -> None:
        """FS_GCS_ENABLE: once a station was heard and is no more, HOLD."""
        if not self.parameters["FS_GCS_ENABLE"] or self._station_ns is None or not self.armed or self.failed_safe:
            return
        if now_ns - self._station_ns > self.parameters["FS_TIMEOUT"] * 1e9:
            self.failed_safe = True
            if self.parameters["FS_ACTION"]:
                self.set_mode(RoverMode.HOLD)

    def _standing(self) -> DriveCommand:
        return DriveCommand(0.0, self._target.curvature_1pm)
