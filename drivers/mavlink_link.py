"""Our end of a MAVLink connection: heartbeats, packets out in ROS units and axes, messages in.

Knows nothing of what the vehicle should do (drivers/mavlink_vehicle.py) nor of what its messages mean
(drivers/mavlink_report.py). Never waits longer than it is told to.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from drivers.errors import LinkFullError
from drivers.mavlink_codec import MavlinkCodec, MavlinkMessage
from drivers.mavlink_constants import (
    LASER_SENSOR,
    LIDAR_ESTIMATOR,
    VELOCITY_AND_YAW_RATE,
    Autopilot,
    Command,
    Component,
    Frame,
    SystemStatus,
    VehicleType,
)
from drivers.mavlink_frames import SECTORS, flipped_pose, obstacle_sectors_cm, quaternion_frd
from drivers.messages import FloatArray, LaserScan
from drivers.sources import ByteLink, Closing
from drivers.vehicle import DriveCommand

OWN_SYSTEM = 255  # what ArduRover's heartbeat failsafe watches (SYSID_MYGCS)
HEARTBEAT_S = 1.0
_SHARE_FOR_TELEMETRY = 0.6  # of a serial line; the rest is for commands and heartbeats
_BURST_S = 0.3
_UNKNOWN_COVARIANCE = [math.nan] + [0.0] * 20
# An origin must be set before ArduPilot's filter takes a pose, and 0 N 0 E counts as none: 100 m beside it.
_ORIGIN_LATITUDE_1E7 = 10_000


class MavlinkLink(Closing):
    """Talks over `link`; clock: returns ns, monotonic. bytes_per_s: what the line carries, None if more than we send.

    target: system and component of the vehicle, once known. unsent: packets that found no room.
    """

    def __init__(
        self, link: ByteLink, clock: Callable[[], int], *, bytes_per_s: float | None = None, system: int = OWN_SYSTEM
    ) -> None:
        self._link = link
        self._clock = clock
        self.codec = MavlinkCodec(system, Component.ONBOARD_COMPUTER)
        self.target = (0, 0)
        self.bytes_heard = 0
        self.messages_heard = 0
        self.unsent = 0
        self._start_ns = clock()
        self._heartbeat_ns: int | None = None
        self._rate = None if bytes_per_s is None else bytes_per_s * _SHARE_FOR_TELEMETRY
        self._room_bytes = 0.0
        self._room_ns = self._start_ns

    def exchange(self, timeout_s: float) -> list[MavlinkMessage]:
        """Send a heartbeat if one is due, return what has come; wait up to timeout_s for the first byte."""
        now_ns = self._clock()
        if self._heartbeat_ns is None or now_ns - self._heartbeat_ns >= HEARTBEAT_S * 1e9:
            self._heartbeat_ns = now_ns
            self.send(
                "HEARTBEAT",
                type=VehicleType.ONBOARD_CONTROLLER,
                autopilot=Autopilot.INVALID,
                base_mode=0,
                custom_mode=0,
                system_status=SystemStatus.ACTIVE,
                mavlink_version=3,
            )
        data = self._link.read(timeout_s)
        self.bytes_heard += len(data)
        own = (self.codec.system, self.codec.component)
        messages = self.codec.decode(data)
        self.messages_heard += len(messages)
        return [message for message in messages if (message.get_srcSystem(), message.get_srcComponent()) != own]

    def send(self, name: str, /, **fields: object) -> None:
        """Send one message now; where the line is full it is dropped and counted."""
        try:
            self._link.write(self.codec.encode(name, **fields))
        except LinkFullError:
            self.unsent += 1

    def setpoint(self, command: DriveCommand) -> None:
        """Send speed and yaw rate in body axes, which expire, rather than a place to go to, which does not."""
        system, component = self.target
        self.send(
            "SET_POSITION_TARGET_LOCAL_NED",
            time_boot_ms=self._since_start_us() // 1000 % 2**32,
            target_system=system,
            target_component=component,
            coordinate_frame=Frame.BODY_NED,
            type_mask=int(VELOCITY_AND_YAW_RATE),
            vx=command.speed_mps,
            vy=0.0,
            vz=0.0,
            yaw_rate=-command.yaw_rate_radps,
            **dict.fromkeys(("x", "y", "z", "afx", "afy", "afz", "yaw"), 0.0),
        )

    def command(self, command: Command, *parameters: float, attempt: int = 0) -> None:
        """Send COMMAND_LONG with its first parameters, the others 0; attempt: 0 for the first."""
        system, component = self.target
        values = (*parameters, *(0.0,) * (7 - len(parameters)))
        self.send(
            "COMMAND_LONG",
            target_system=system,
            target_component=component,
            command=command,
            confirmation=attempt,
            **{f"param{k + 1}": float(value) for k, value in enumerate(values)},
        )

    def ask_parameter(self, name: str) -> None:
        """Ask for one parameter."""
        system, component = self.target
        self.send(
            "PARAM_REQUEST_READ",
            target_system=system,
            target_component=component,
            param_id=name.encode("ascii"),
            param_index=-1,
        )

    def set_origin(self) -> None:
        """Give the vehicle's filter an origin; where it is does not matter without GPS."""
        self.send(
            "SET_GPS_GLOBAL_ORIGIN",
            target_system=self.target[0],
            latitude=_ORIGIN_LATITUDE_1E7,
            longitude=0,
            altitude=0,
        )

    def odometry(self, T_map_base: FloatArray, twist: FloatArray, resets: int) -> None:
        """Send pose and body twist (3,), of the map and of base_link in ROS axes; resets: jumps so far, modulo 256."""
        if not self._has_room(244):
            return
        x_m, y_m, _ = flipped_pose(T_map_base).tolist()
        vx, vy, yaw_rate = flipped_pose(twist).tolist()
        self.send(
            "ODOMETRY",
            time_usec=self._since_start_us(),
            frame_id=Frame.LOCAL_FRD,
            child_frame_id=Frame.BODY_FRD,
            x=x_m,
            y=y_m,
            q=quaternion_frd(float(T_map_base[2])),
            vx=vx,
            vy=vy,
            yawspeed=yaw_rate,
            pose_covariance=_UNKNOWN_COVARIANCE,
            velocity_covariance=_UNKNOWN_COVARIANCE,
            reset_counter=resets % 256,
            estimator_type=LIDAR_ESTIMATOR,
            **dict.fromkeys(("z", "vz", "rollspeed", "pitchspeed"), 0.0),
        )

    def obstacles(self, scan: LaserScan, T_base_laser: FloatArray) -> None:
        """Send the nearest distance in each of 72 sectors."""
        if not self._has_room(179):
            return
        self.send(
            "OBSTACLE_DISTANCE",
            time_usec=self._since_start_us(),
            sensor_type=LASER_SENSOR,
            distances=obstacle_sectors_cm(scan, T_base_laser),
            increment=round(360 / SECTORS),
            increment_f=360.0 / SECTORS,
            angle_offset=0.0,
            min_distance=max(1, math.ceil(scan.range_min_m * 100.0)),
            max_distance=min(65534, math.floor(scan.range_max_m * 100.0)),
            frame=Frame.BODY_FRD,
        )

    def close(self) -> None:
        """Release the link."""
        self._link.close()

    def _since_start_us(self) -> int:
        return (self._clock() - self._start_ns) // 1000

    def _has_room(self, size_bytes: int) -> bool:
        """Whether telemetry of this size leaves a serial line room for commands; takes the room if so."""
        if self._rate is None:
            return True
        now_ns = self._clock()
        gained = (now_ns - self._room_ns) * 1e-9 * self._rate
        self._room_bytes = min(self._room_bytes + gained, max(self._rate * _BURST_S, size_bytes))
        self._room_ns = now_ns
        if self._room_bytes < size_bytes:
            return False
        self._room_bytes -= size_bytes
        return True
