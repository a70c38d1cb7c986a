"""A car behind MAVLink: ArduRover in its GUIDED mode, or what behaves like it.

Commands are setpoints that expire, three times over: the car stops without them after its own timeout; they are
repeated at 20 Hz only for half a second after drive() was called last, then replaced by standstill; and the car
that is lost, armed anew by others or put into another mode gets none until arm() is called again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType

from typing_extensions import Self

from drivers.errors import DriverError, SilentPortError, WrongBaudError
from drivers.mavlink_address import MavlinkAddress
from drivers.mavlink_checklist import ARDUROVER_SETPOINT_TIMEOUT_S, PARAMETERS, SETPOINT_TIMEOUT, checklist
from drivers.mavlink_codec import MavlinkMessage
from drivers.mavlink_constants import (
    ATTITUDE,
    SCALED_IMU,
    WHEEL_DISTANCE,
    Autopilot,
    Command,
    CommandResult,
    ModeFlag,
)
from drivers.mavlink_link import MavlinkLink
from drivers.mavlink_modes import Modes, modes_of
from drivers.mavlink_report import VehicleReport, is_vehicle
from drivers.messages import FloatArray, LaserScan
from drivers.sources import ByteLink
from drivers.vehicle import (
    STANDSTILL,
    ArmingRefusedError,
    DriveCommand,
    LostVehicleError,
    VehicleLinkError,
    VehicleMessage,
    VehicleState,
    WrongModeError,
)

_ENABLE_CUSTOM_MODE = float(ModeFlag.CUSTOM_MODE)
_STEP_S = 0.02
_BURST = 3


@dataclass(frozen=True, slots=True)
class MavlinkSettings:
    """Deadlines in s. repeat_s: between setpoints; command_life_s: how long one drive() call is repeated.

    lost_after_s: of silence. connect_s: for the first heartbeat. answer_s: for one answer, asked for `attempts` times.
    telemetry_hz: of wheel odometry and IMU, which the vehicle is asked for.
    """

    repeat_s: float = 0.05
    command_life_s: float = 0.5
    lost_after_s: float = 2.5
    connect_s: float = 5.0
    answer_s: float = 1.0
    attempts: int = 3
    telemetry_hz: float = 20.0
    standing_s: float = 1.0  # how long standstill is repeated after a stop


def open_mavlink(address: MavlinkAddress, clock: Callable[[], int]) -> MavlinkVehicle:
    """Return the vehicle at an address, not yet connected; clock: returns ns, never steps back."""
    return MavlinkVehicle(str(address), address.open, clock, bytes_per_s=address.bytes_per_s)


class MavlinkVehicle:
    """See drivers.vehicle.Vehicle. open_link: opens the bytes' way when the context is entered.

    warnings: what is amiss with the vehicle's own safety nets. All calls from one thread.
    """

    def __init__(
        self,
        name: str,
        open_link: Callable[[], ByteLink],
        clock: Callable[[], int],
        *,
        settings: MavlinkSettings | None = None,
        bytes_per_s: float | None = None,
    ) -> None:
        self.name = name
        self.warnings: tuple[str, ...] = ()
        self.setpoint_timeout_s: float | None = None
        self.settings = settings or MavlinkSettings()
        self._open_link = open_link
        self._clock = clock
        self._bytes_per_s = bytes_per_s
        self._link: MavlinkLink | None = None
        self._report = VehicleReport()
        self._engaged = False  # arm() has succeeded, and nothing has happened since that ends our command
        self._why_not = "not armed"
        self._emergency = False
        self._lost = False
        self._command, self._commanded_ns = STANDSTILL, 0
        self._sent_ns = 0
        self._standing_until_ns = 0
        self._asked_ns = 0
        self._resets = 0
        self._origin_told = False
        self._state: VehicleState | None = None
        self._state_told_ns = 0

    # ------------------------------------------------------------------------------------------------- connection
    def __enter__(self) -> Self:
        """Connect, read parameters, ask for telemetry; SilentPortError, WrongBaudError or another DriverError."""
        self._report = VehicleReport()
        self._link = MavlinkLink(self._open_link(), self._clock, bytes_per_s=self._bytes_per_s)
        try:
            if not self._wait(lambda: self._report.heartbeat is not None, self.settings.connect_s):
                raise self._silent()
            self._read_parameters()
            for message in (ATTITUDE, WHEEL_DISTANCE, SCALED_IMU):
                self.link.command(Command.SET_MESSAGE_INTERVAL, message, 1e6 / self.settings.telemetry_hz)
        except BaseException:
            self._link.close()
            self._link = None
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._link is None:
            return
        try:
            if self._engaged:
                self.stop()
                self._wait(self._holds, self.settings.answer_s)
        except DriverError:  # the way to the car is gone; its own timeout stops it
            pass
        finally:
            self._link.close()
            self._link = None

    @property
    def link(self) -> MavlinkLink:
        """The open link; VehicleLinkError outside the context."""
        if self._link is None:
            raise VehicleLinkError(f"{self.name}: not connected: use it in a with block")
        return self._link

    @property
    def parameters(self) -> dict[str, float]:
        """What the vehicle has told of its parameters."""
        return dict(self._report.parameters)

    # ------------------------------------------------------------------------------------------------- commands
    def arm(self) -> None:
        """Put the car into GUIDED and arm it; also takes back an emergency stop and a lost link."""
        self._hear(0.0)
        self._check_heard()
        self._command, self._commanded_ns = STANDSTILL, self._clock()
        modes = self._modes
        # Autopilots go into such a mode only where setpoints already come, and then stand.
        self._standing_until_ns = self._clock() + round(self.settings.standing_s * 1e9)
        if not self._ask(Command.DO_SET_MODE, self._is_guided, _ENABLE_CUSTOM_MODE, *modes.guided):
            raise WrongModeError(
                f"{self.name}: the vehicle stays in {self._mode} instead of {modes.guided_name}"
                f"{self._answer(Command.DO_SET_MODE)}: check its mode switch"
            )
        if not self._ask(Command.ARM_DISARM, self._is_armed, 1.0):
            raise ArmingRefusedError(
                f"{self.name}: the vehicle does not arm{self._answer(Command.ARM_DISARM)}: mend that, or see its log"
            )
        self._engaged, self._emergency, self._lost, self._why_not = True, False, False, ""

    def disarm(self) -> None:
        """Take the drive's power away; VehicleLinkError where the vehicle does not."""
        self._disengage("disarmed")
        if not self._ask(Command.ARM_DISARM, lambda: not self._is_armed(), 0.0):
            raise VehicleLinkError(f"{self.name}: the vehicle stays armed{self._answer(Command.ARM_DISARM)}")

    def drive(self, command: DriveCommand) -> None:
        """Send the command now, and again from poll() for half a second; nothing where the state is not ready."""
        if not self._engaged:
            return
        self._command, self._commanded_ns = command, self._clock()
        self._send(command)

    def stop(self) -> None:
        """Standstill at once, HOLD behind it; arm() before driving on."""
        self._disengage("stopped")
        self._burst()
        self.link.command(Command.DO_SET_MODE, _ENABLE_CUSTOM_MODE, *self._modes.hold)

    def emergency_stop(self) -> None:
        """Standstill, HOLD and disarming at once, the last repeated until the vehicle is disarmed."""
        self._emergency = True
        self._disengage("emergency stop: arm again")
        self._burst()
        self._cut_power()

    def poll(self) -> Sequence[VehicleMessage]:
        """Exchange messages, repeat what is to be repeated, return what has come."""
        self._hear(0.0)
        now_ns = self._clock()
        self._watch(now_ns)
        self._repeat(now_ns)
        if self._lost:
            self._check_heard()
        state, measured = self._present_state(now_ns), self._report.take()
        changed = self._state is None or (state.armed, state.mode, state.ready, state.reason) != (
            self._state.armed,
            self._state.mode,
            self._state.ready,
            self._state.reason,
        )
        if not changed and now_ns - self._state_told_ns < 1_000_000_000:
            return measured
        self._state, self._state_told_ns = state, now_ns
        return [*measured, state]

    def tell_pose(self, stamp_ns: int, T_map_base: FloatArray, twist: FloatArray, *, jumped: bool = False) -> None:
        """Send ODOMETRY; a jump counts the reset counter up, so that the vehicle's filter starts anew there."""
        del stamp_ns  # our clock is not the vehicle's: it takes the arrival
        if not self._origin_told:
            self.link.set_origin()
            self._origin_told = True
        self._resets += jumped
        self.link.odometry(T_map_base, twist, self._resets)

    def tell_scan(self, scan: LaserScan, T_base_laser: FloatArray) -> None:
        """Send OBSTACLE_DISTANCE."""
        self.link.obstacles(scan, T_base_laser)

    # ------------------------------------------------------------------------------------------------- inside
    def _hear(self, timeout_s: float) -> None:
        link = self.link
        for message in link.exchange(timeout_s):
            sender = (message.get_srcSystem(), message.get_srcComponent())
            if link.target == (0, 0) and message.get_type() == "HEARTBEAT" and is_vehicle(message):
                link.target = sender
            if sender == link.target:
                self._take(message)

    def _take(self, message: MavlinkMessage) -> None:
        self._report.hear(message, self._clock())

    def _wait(self, reached: Callable[[], bool], timeout_s: float) -> bool:
        """Exchange messages until `reached` or the time is over."""
        deadline_ns = self._clock() + round(timeout_s * 1e9)
        while not reached():
            if self._clock() >= deadline_ns:
                return False
            self._hear(_STEP_S)
            self._repeat(self._clock())
        return True

    def _ask(self, command: Command, reached: Callable[[], bool], *parameters: float) -> bool:
        """Send a command until its effect shows in a heartbeat; False where it is refused or nothing happens."""
        if reached() and command == Command.DO_SET_MODE:
            return True
        for attempt in range(self.settings.attempts):
            self._report.answers.pop(command, None)
            self.link.command(command, *parameters, attempt=attempt)
            self._wait(lambda: reached() or command in self._report.answers, self.settings.answer_s)
            answer = self._report.answers.get(command)
            if answer == CommandResult.ACCEPTED or (answer is None and reached()):
                return self._wait(reached, 2.0 * self.settings.answer_s)  # the next heartbeat may be 1 s away
            if answer not in {None, CommandResult.TEMPORARILY_REJECTED, CommandResult.IN_PROGRESS}:
                return False
            self._check_heard()
        return False

    def _answer(self, command: Command) -> str:
        """Return what the vehicle answered to a command, and said last, as the middle of a sentence."""
        result = self._report.answers.get(command)
        known = result in CommandResult.__members__.values()
        told = "" if result is None else f" ({CommandResult(result).name if known else f'result {result}'})"
        words = [word for word in self._report.words[-3:] if word]
        return f"{told}, it says: {'; '.join(words)}" if words else told

    def _read_parameters(self) -> None:
        told = self._report.parameters
        for _ in range(2):
            for name in PARAMETERS:
                if name not in told:
                    self.link.ask_parameter(name)
                    self._hear(0.0)
            if self._wait(lambda: set(PARAMETERS) <= told.keys(), self.settings.answer_s / 2.0):
                break
        self.warnings = checklist(self._report.parameters, self.link.codec.system)
        self.setpoint_timeout_s = self._report.parameters.get(SETPOINT_TIMEOUT)
        if self.setpoint_timeout_s is None and self._is_ardupilot():
            self.setpoint_timeout_s = ARDUROVER_SETPOINT_TIMEOUT_S

    def _watch(self, now_ns: int) -> None:
        """End our command where the vehicle is lost, or others have taken it over."""
        heartbeat = self._report.heartbeat
        heard_ns = -1 if heartbeat is None else heartbeat.stamp_ns
        if now_ns - heard_ns > self.settings.lost_after_s * 1e9:
            if not self._lost:
                self._disengage(f"no heartbeat for {self.settings.lost_after_s:g} s: arm again once it is back")
                self._burst()
            self._lost, self._standing_until_ns = True, now_ns + 1
            return
        self._lost = False
        if self._engaged and not self._is_armed():
            self._disengage("the vehicle has disarmed itself")
        elif self._engaged and not self._is_guided():
            self._disengage(f"the vehicle is in {self._mode}: somebody else drives, arm again to go on")
        if self._emergency and self._is_armed() and now_ns - self._asked_ns > 200_000_000:
            self._cut_power()

    def _repeat(self, now_ns: int) -> None:
        if now_ns - self._sent_ns < self.settings.repeat_s * 1e9:
            return
        if self._engaged:
            fresh = now_ns - self._commanded_ns <= self.settings.command_life_s * 1e9
            self._send(self._command if fresh else STANDSTILL)
        elif now_ns < self._standing_until_ns:
            self._send(STANDSTILL)

    def _send(self, command: DriveCommand) -> None:
        self._sent_ns = self._clock()
        self.link.setpoint(command)

    def _burst(self) -> None:
        """Standstill several times over, since packets get lost, and again from poll() for a second."""
        self._standing_until_ns = self._clock() + round(self.settings.standing_s * 1e9)
        for _ in range(_BURST):
            self._send(STANDSTILL)

    def _cut_power(self) -> None:
        self._asked_ns = self._clock()
        self.link.command(Command.DO_SET_MODE, _ENABLE_CUSTOM_MODE, *self._modes.hold)
        self.link.command(Command.ARM_DISARM, 0.0)

    def _disengage(self, reason: str) -> None:
        self._engaged, self._command = False, STANDSTILL
        self._why_not = "emergency stop: arm again" if self._emergency else reason

    def _present_state(self, now_ns: int) -> VehicleState:
        return VehicleState(now_ns, self._is_armed(), self._mode, self._engaged, self._why_not)

    def _check_heard(self) -> None:
        heartbeat = self._report.heartbeat
        if heartbeat is None or self._clock() - heartbeat.stamp_ns > self.settings.lost_after_s * 1e9:
            raise LostVehicleError(
                f"{self.name}: no heartbeat of the vehicle for {self.settings.lost_after_s:g} s: standstill is sent, "
                "and its own timeout stops it: check link and supply, then arm again"
            )

    def _silent(self) -> DriverError:
        link, seconds = self.link, self.settings.connect_s
        if not link.bytes_heard:
            return SilentPortError(
                f"{self.name}: nothing arrives in {seconds:g} s: check wiring, address, and that the vehicle is on"
            )
        if not link.messages_heard:
            return WrongBaudError(f"{self.name}: what arrives is no MAVLink: check the speed, and SERIALx_PROTOCOL 2")
        return SilentPortError(f"{self.name}: MAVLink arrives, but no vehicle's heartbeat in {seconds:g} s")

    @property
    def _modes(self) -> Modes:
        heartbeat = self._report.heartbeat
        return modes_of(-1 if heartbeat is None else heartbeat.autopilot)

    @property
    def _mode(self) -> str:
        heartbeat = self._report.heartbeat
        return "unknown" if heartbeat is None else heartbeat.mode

    def _is_guided(self) -> bool:
        return self._mode == self._modes.guided_name

    def _is_armed(self) -> bool:
        heartbeat = self._report.heartbeat
        return heartbeat is not None and heartbeat.armed

    def _is_ardupilot(self) -> bool:
        heartbeat = self._report.heartbeat
        return heartbeat is not None and heartbeat.autopilot == Autopilot.ARDUPILOT

    def _holds(self) -> bool:
        return not self._is_guided()
