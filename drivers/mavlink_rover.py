"""An emulated ArduRover: MAVLink bytes in and out, a small car's motion between; on any link, in any time.

Not imitated: RC, missions, fences, the EKF (poses and obstacles that are told to it are kept, not used), signing, and
speed and steering controllers, which here do what is asked of them within the car's limits.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from drivers.mavlink_codec import MavlinkCodec, MavlinkMessage
from drivers.mavlink_constants import (
    ATTITUDE,
    FLOAT_PARAMETER,
    SCALED_IMU,
    WHEEL_DISTANCE,
    Autopilot,
    Command,
    CommandResult,
    Component,
    Frame,
    Ignore,
    ModeFlag,
    RoverMode,
    SystemStatus,
    VehicleType,
)
from drivers.rover_autopilot import RoverAutopilot
from drivers.rover_dynamics import NoisyOdometry, RoverDynamics, RoverState
from drivers.rover_faults import RoverFault, RoverFaultKind, any_holds

_HEARTBEAT_NS = 1_000_000_000
_MOTION_NS = 10_000_000
_BODY_FRAMES = (Frame.BODY_NED, Frame.BODY_OFFSET_NED)
_AUTOPILOT_VERSION = 148
_VERSION_4_5 = 0x040500FF
_HEARS_NOTHING = (RoverFaultKind.DEAF, RoverFaultKind.CUT)
_SENDS_NOTHING = (RoverFaultKind.SILENCE, RoverFaultKind.CUT)


class MavlinkRover:
    """See drivers.emulated_link.EmulatedDevice; switched on at the first call.

    dynamics: the car, which moves as time passes here. received: how often each message came in; last: its last one.
    odometry: what it measures of its own motion; its seed fixes the noise.
    """

    def __init__(
        self,
        dynamics: RoverDynamics,
        *,
        odometry: NoisyOdometry | None = None,
        faults: Sequence[RoverFault] = (),
        parameters: dict[str, float] | None = None,
    ) -> None:
        self.autopilot = RoverAutopilot(parameters)
        self.received: Counter[str] = Counter()
        self.last: dict[str, MavlinkMessage] = {}
        self._dynamics = dynamics
        self._odometry = odometry or NoisyOdometry(seed=0)
        self._measured = self._odometry.measure(0, dynamics.state)
        self._last_speed_mps = 0.0
        self._acceleration_mps2 = 0.0
        self._faults = tuple(faults)
        self._codec = MavlinkCodec(int(self.autopilot.parameters["SYSID_THISMAV"]), Component.AUTOPILOT)
        self._start_ns: int | None = None
        self._now_ns = 0
        self._heartbeat_ns = 0
        self._sent_ns: dict[int, int] = {}
        self._intervals_ns: dict[int, int] = {}

    @property
    def state(self) -> RoverState:
        """Where the car truly is; for the world around it and for scores, never for the link."""
        return self._dynamics.state

    @property
    def contacts(self) -> int:
        """How often a wall has stopped it."""
        return self._dynamics.contacts

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Take bytes from the host; return what is answered at once."""
        self.pass_time(now_ns)
        if self._on(*_HEARS_NOTHING):
            return b""
        answers = b"".join(self._answer(message) for message in self._codec.decode(data))
        return b"" if self._on(*_SENDS_NOTHING) else answers

    def due(self, now_ns: int) -> bytes:
        """Return heartbeats and telemetry that are due."""
        self.pass_time(now_ns)
        sent = b""
        if now_ns >= self._heartbeat_ns:
            self._heartbeat_ns = now_ns + _HEARTBEAT_NS
            sent += self._heartbeat()
        for message, interval_ns in self._intervals_ns.items():
            if now_ns - self._sent_ns.get(message, -interval_ns) >= interval_ns:
                self._sent_ns[message] = now_ns
                sent += self._telemetry(message)
        return b"" if self._on(*_SENDS_NOTHING) else sent

    def power_up(self, now_ns: int) -> None:
        """Nothing: the car has a battery of its own, and a plug that is pulled takes the link alone."""

    def begin(self, kind: RoverFaultKind) -> None:
        """Let a fault that lasts begin now, and never end."""
        self._faults = (*self._faults, RoverFault(kind, self._seconds))

    # ------------------------------------------------------------------------------------------------- motion
    def pass_time(self, now_ns: int) -> None:
        """Move the car up to now, in steps of its control loop, and send nothing: for the world around it."""
        if self._start_ns is None:
            self._start_ns = self._now_ns = self._heartbeat_ns = now_ns
        while self._now_ns < now_ns:
            step_ns = min(_MOTION_NS, now_ns - self._now_ns)
            before_s = self._seconds
            self._now_ns += step_ns
            self._suffer(before_s, self._seconds)
            state = self._dynamics.step(step_ns * 1e-9, self.autopilot.command(self._now_ns))
            self._measured = self._odometry.measure(self._now_ns, state)
            self._acceleration_mps2 = (state.speed_mps - self._last_speed_mps) / (step_ns * 1e-9)
            self._last_speed_mps = state.speed_mps

    def _suffer(self, from_s: float, to_s: float) -> None:
        for fault in self._faults:
            if from_s < fault.start_s <= to_s:
                if fault.kind == RoverFaultKind.MODE and fault.mode is not None:
                    self.autopilot.set_mode(fault.mode)
                elif fault.kind == RoverFaultKind.DISARM:
                    self.autopilot.set_armed(False)

    @property
    def _seconds(self) -> float:
        return (self._now_ns - (self._start_ns or 0)) * 1e-9

    def _on(self, *kinds: RoverFaultKind) -> bool:
        return any_holds(self._faults, self._seconds, *kinds)

    # ------------------------------------------------------------------------------------------------- hearing
    def _answer(self, message: MavlinkMessage) -> bytes:
        kind = message.get_type()
        self.received[kind] += 1
        self.last[kind] = message
        if getattr(message, "target_system", 0) not in {0, self._codec.system}:
            return b""
        if kind == "HEARTBEAT":
            self.autopilot.hear_station(message.get_srcSystem(), self._now_ns)
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            self._take_target(message)
        elif kind == "SET_MODE":
            self._set_mode(message.custom_mode)
        elif kind in {"COMMAND_LONG", "COMMAND_INT"}:
            return self._obey(message)
        elif kind == "TIMESYNC" and message.tc1 == 0:
            return self._codec.encode("TIMESYNC", tc1=self._now_ns, ts1=message.ts1)
        elif kind == "PARAM_REQUEST_LIST":
            return b"".join(self._parameter(name) for name in sorted(self.autopilot.parameters))
        elif kind == "PARAM_REQUEST_READ":
            known = sorted(self.autopilot.parameters)
            index = message.param_index
            return self._parameter(known[index] if 0 <= index < len(known) else message.param_id)
        elif kind == "PARAM_SET" and message.param_id in self.autopilot.parameters:
            self.autopilot.parameters[message.param_id] = message.param_value
            return self._parameter(message.param_id)
        return b""

    def _take_target(self, message: MavlinkMessage) -> None:
        """Speed and yaw rate, or a velocity in body axes, as Rover/GCS_Mavlink.cpp reads them; others move nothing."""
        mask = Ignore(message.type_mask & 0xFFF)
        if (
            Ignore.POSITION not in mask
            or mask & (Ignore.VX | Ignore.VY)
            or message.coordinate_frame not in _BODY_FRAMES
        ):
            return
        speed = math.copysign(math.hypot(message.vx, message.vy), message.vx)
        yaw_rate = 0.0 if Ignore.YAW_RATE in mask else -message.yaw_rate
        if math.isfinite(speed) and math.isfinite(yaw_rate):
            self.autopilot.set_target(speed, yaw_rate, self._now_ns)

    def _set_mode(self, custom_mode: float) -> CommandResult:
        if custom_mode not in RoverMode.__members__.values():
            return CommandResult.FAILED
        self.autopilot.set_mode(RoverMode(int(custom_mode)))
        self._heartbeat_ns = self._now_ns  # told at once
        return CommandResult.ACCEPTED

    def _obey(self, message: MavlinkMessage) -> bytes:
        command, told = message.command, b""
        result = CommandResult.ACCEPTED
        if command == Command.DO_SET_MODE:
            result = self._set_mode(message.param2)
        elif command == Command.ARM_DISARM:
            result, told = self._arm(message.param1 == 1.0)
        elif command == Command.SET_MESSAGE_INTERVAL:
            result = self._set_interval(int(message.param1), message.param2)
        elif command == Command.REQUEST_MESSAGE and int(message.param1) == _AUTOPILOT_VERSION:
            told = self._version()
        else:
            result = CommandResult.UNSUPPORTED
        acknowledged = self._codec.encode(
            "COMMAND_ACK",
            command=command,
            result=result,
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
        )
        return acknowledged + told

    def _arm(self, armed: bool) -> tuple[CommandResult, bytes]:
        if armed and self._on(RoverFaultKind.REFUSE_ARM):
            told = self._codec.encode("STATUSTEXT", severity=2, text=b"PreArm: refused by a fault of the emulator")
            return CommandResult.FAILED, told
        self.autopilot.set_armed(armed)
        self._heartbeat_ns = self._now_ns
        text = b"Throttle armed" if armed else b"Throttle disarmed"
        return CommandResult.ACCEPTED, self._codec.encode("STATUSTEXT", severity=6, text=text)

    def _set_interval(self, message: int, interval_us: float) -> CommandResult:
        if message not in {ATTITUDE, WHEEL_DISTANCE, SCALED_IMU}:
            return CommandResult.FAILED
        self._intervals_ns.pop(message, None)
        if interval_us > 0:
            self._intervals_ns[message] = round(interval_us * 1000)
        return CommandResult.ACCEPTED

    # ------------------------------------------------------------------------------------------------- sending
    def _heartbeat(self) -> bytes:
        armed = ModeFlag.ARMED if self.autopilot.armed else ModeFlag(0)
        guided = ModeFlag.GUIDED if self.autopilot.mode == RoverMode.GUIDED else ModeFlag.MANUAL_INPUT
        return self._codec.encode(
            "HEARTBEAT",
            type=VehicleType.GROUND_ROVER,
            autopilot=Autopilot.ARDUPILOT,
            base_mode=int(ModeFlag.CUSTOM_MODE | armed | guided),
            custom_mode=self.autopilot.mode,
            system_status=SystemStatus.ACTIVE if self.autopilot.armed else SystemStatus.STANDBY,
            mavlink_version=3,
        )

    def _telemetry(self, message: int) -> bytes:
        boot_ms = (self._now_ns - (self._start_ns or 0)) // 1_000_000
        yaw_rate = float(self._measured.twist[2])
        if message == ATTITUDE:
            return self._codec.encode(
                "ATTITUDE",
                time_boot_ms=boot_ms,
                yaw=-float(self._measured.pose[2]),
                yawspeed=-yaw_rate,
                **dict.fromkeys(("roll", "pitch", "rollspeed", "pitchspeed"), 0.0),
            )
        if message == WHEEL_DISTANCE:
            distances = [self._odometry.way_m, self._odometry.way_m, *(0.0,) * 14]
            return self._codec.encode("WHEEL_DISTANCE", time_usec=boot_ms * 1000, count=2, distance=distances)
        felt = np.array([self._acceleration_mps2, -self.state.speed_mps * yaw_rate, -9.80665]) / 9.80665 * 1000.0
        x, y, z = (round(value) for value in np.clip(felt, -32768, 32767).tolist())
        return self._codec.encode(
            "SCALED_IMU",
            time_boot_ms=boot_ms,
            xacc=x,
            yacc=y,
            zacc=z,
            zgyro=round(max(-32.0, min(32.0, -yaw_rate)) * 1000.0),
            **dict.fromkeys(("xgyro", "ygyro", "xmag", "ymag", "zmag"), 0),
        )

    def _parameter(self, name: str) -> bytes:
        known = sorted(self.autopilot.parameters)
        if name not in known:
            return b""
        return self._codec.encode(
            "PARAM_VALUE",
            param_id=name.encode("ascii"),
            param_value=self.autopilot.parameters[name],
            param_type=FLOAT_PARAMETER,
            param_count=len(known),
            param_index=known.index(name),
        )

    def _version(self) -> bytes:
        nothing = dict.fromkeys(
            ("middleware_sw_version", "os_sw_version", "board_version", "vendor_id", "product_id"), 0
        )
        custom = [0] * 8
        return self._codec.encode(
            "AUTOPILOT_VERSION",
            capabilities=0x2 | 0x80 | 0x2000,  # float parameters, SET_POSITION_TARGET_LOCAL_NED, MAVLink 2
            flight_sw_version=_VERSION_4_5,
            flight_custom_version=custom,
            middleware_custom_version=custom,
            os_custom_version=custom,
            uid=1,
            **nothing,
        )
