"""A car behind MAVLink: ArduRover in its GUIDED mode, or what behaves like it.

Commands are setpoints that expire, three times over: the car stops without them after its own timeout; they are
repeated at 20 Hz only for half a second after drive() was called last, then replaced by standstill; and the car
that is lost, armed anew by others or put into another mode gets none until arm() is called again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType

from typing_extensions import Self

from drivers.errors import DriverError
from drivers.mavlink_address import MavlinkAddress
from drivers.mavlink_checklist import checklist
from drivers.mavlink_constants import ATTITUDE, SCALED_IMU, WHEEL_DISTANCE, Command, ModeFlag
from drivers.mavlink_dialogue import Dialogue
from drivers.mavlink_link import MavlinkLink
from drivers.mavlink_setpoints import Setpoints
from drivers.mavlink_settings import MavlinkSettings
from drivers.messages import FloatArray, LaserScan
from drivers.sources import ByteLink
from drivers.vehicle import (
    ArmingRefusedError,
    DriveCommand,
    VehicleLinkError,
    VehicleMessage,
    VehicleState,
    WrongModeError,
)

_ENABLE_CUSTOM_MODE = float(ModeFlag.CUSTOM_MODE)
_CUT_AGAIN_NS = 200_000_000
_STATE_NS = 1_000_000_000


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
        self._connection: _Connection | None = None
        self._why_not = "not armed"
        self._emergency = False
        self._lost = False
        self._asked_ns = 0
        self._resets = 0
        self._origin_told = False
        self._state: VehicleState | None = None
        self._state_told_ns = 0

    # ------------------------------------------------------------------------------------------------- connection
    def __enter__(self) -> Self:
        """Connect, read parameters, ask for telemetry; SilentPortError, WrongBaudError or another DriverError."""
        link = MavlinkLink(self._open_link(), self._clock, bytes_per_s=self._bytes_per_s)
        self._connection = found = _Connection(self.name, link, self._clock, self.settings)
        try:
            found.dialogue.await_vehicle()
            found.dialogue.read_parameters()
            self.warnings = checklist(found.dialogue.report.parameters, found.link.codec.system)
            self.setpoint_timeout_s = found.dialogue.setpoint_timeout_s
            for message in (ATTITUDE, WHEEL_DISTANCE, SCALED_IMU):
                found.link.command(Command.SET_MESSAGE_INTERVAL, message, 1e6 / self.settings.telemetry_hz)
        except BaseException:
            found.link.close()
            self._connection = None
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._connection is None:
            return
        try:
            if self._setpoints.engaged:
                self.stop()
                self._dialogue.wait(lambda: not self._dialogue.is_guided(), self.settings.answer_s)
        except DriverError:  # the way to the car is gone; its own timeout stops it
            pass
        finally:
            self._connection.link.close()
            self._connection = None

    @property
    def link(self) -> MavlinkLink:
        """The open link; VehicleLinkError outside the context."""
        return self._open.link

    @property
    def parameters(self) -> dict[str, float]:
        """What the vehicle has told of its parameters."""
        return dict(self._dialogue.report.parameters)

    # ------------------------------------------------------------------------------------------------- commands
    def arm(self) -> None:
        """Put the car into GUIDED and arm it; also takes back an emergency stop and a lost link."""
        talk = self._dialogue
        talk.hear()
        talk.check_heard()
        # Autopilots go into such a mode only where setpoints already come, and then stand.
        self._setpoints.stand_for(self.settings.standing_s)
        if not talk.ask(Command.DO_SET_MODE, talk.is_guided, _ENABLE_CUSTOM_MODE, *talk.modes.guided):
            raise WrongModeError(
                f"{self.name}: the vehicle stays in {talk.mode} instead of {talk.modes.guided_name}"
                f"{talk.answer(Command.DO_SET_MODE)}: check its mode switch"
            )
        if not talk.ask(Command.ARM_DISARM, talk.is_armed, 1.0):
            raise ArmingRefusedError(
                f"{self.name}: the vehicle does not arm{talk.answer(Command.ARM_DISARM)}: mend that, or see its log"
            )
        self._setpoints.engage()
        self._emergency, self._lost, self._why_not = False, False, ""

    def disarm(self) -> None:
        """Take the drive's power away; VehicleLinkError where the vehicle does not."""
        self._disengage("disarmed")
        talk = self._dialogue
        if not talk.ask(Command.ARM_DISARM, lambda: not talk.is_armed(), 0.0):
            raise VehicleLinkError(f"{self.name}: the vehicle stays armed{talk.answer(Command.ARM_DISARM)}")

    def drive(self, command: DriveCommand) -> None:
        """Send the command now, and again from poll() for half a second; nothing where the state is not ready."""
        self._setpoints.drive(command)

    def stop(self) -> None:
        """Standstill at once, HOLD behind it; arm() before driving on."""
        self._disengage("stopped")
        self._setpoints.burst()
        self.link.command(Command.DO_SET_MODE, _ENABLE_CUSTOM_MODE, *self._dialogue.modes.hold)

    def emergency_stop(self) -> None:
        """Standstill, HOLD and disarming at once, the last repeated until the vehicle is disarmed."""
        self._emergency = True
        self._disengage("emergency stop: arm again")
        self._setpoints.burst()
        self._cut_power()

    def poll(self) -> Sequence[VehicleMessage]:
        """Exchange messages, repeat what is to be repeated, return what has come."""
        self._dialogue.hear()
        now_ns = self._clock()
        self._watch(now_ns)
        self._setpoints.repeat()
        if self._lost:
            self._dialogue.check_heard()
        state, measured = self._present_state(now_ns), self._dialogue.report.take()
        changed = self._state is None or (state.armed, state.mode, state.ready, state.reason) != (
            self._state.armed,
            self._state.mode,
            self._state.ready,
            self._state.reason,
        )
        if not changed and now_ns - self._state_told_ns < _STATE_NS:
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
    def _watch(self, now_ns: int) -> None:
        """End our command where the vehicle is lost, or others have taken it over; hold it while it does not hear."""
        talk = self._dialogue
        if missing := talk.missing:
            if not self._lost:
                self._disengage(f"no {missing} for {self.settings.lost_after_s:g} s: arm again once it is back")
                self._setpoints.burst()
            self._lost = True
            self._setpoints.stand_for(2.0 * self.settings.repeat_s)
            return
        self._lost = False
        self._setpoints.held = talk.unanswered_s > self.settings.unheard_after_s
        if self._setpoints.engaged and not talk.is_armed():
            self._disengage("the vehicle has disarmed itself")
        elif self._setpoints.engaged and not talk.is_guided():
            self._disengage(f"the vehicle is in {talk.mode}: somebody else drives, arm again to go on")
        if self._emergency and talk.is_armed() and now_ns - self._asked_ns > _CUT_AGAIN_NS:
            self._cut_power()

    def _cut_power(self) -> None:
        self._asked_ns = self._clock()
        self.link.command(Command.DO_SET_MODE, _ENABLE_CUSTOM_MODE, *self._dialogue.modes.hold)
        self.link.command(Command.ARM_DISARM, 0.0)

    def _disengage(self, reason: str) -> None:
        self._setpoints.disengage()
        self._why_not = "emergency stop: arm again" if self._emergency else reason

    def _present_state(self, now_ns: int) -> VehicleState:
        talk, setpoints = self._dialogue, self._setpoints
        reason = self._why_not
        if setpoints.engaged and setpoints.held:
            reason = f"it has not answered for {self.settings.unheard_after_s:g} s, it may not hear us"
        return VehicleState(now_ns, talk.is_armed(), talk.mode, setpoints.engaged and not setpoints.held, reason)

    @property
    def _open(self) -> _Connection:
        if self._connection is None:
            raise VehicleLinkError(f"{self.name}: not connected: use it in a with block")
        return self._connection

    @property
    def _dialogue(self) -> Dialogue:
        return self._open.dialogue

    @property
    def _setpoints(self) -> Setpoints:
        return self._open.setpoints


class _Connection:
    """What lives from connecting to closing."""

    def __init__(self, name: str, link: MavlinkLink, clock: Callable[[], int], settings: MavlinkSettings) -> None:
        self.link = link
        self.setpoints = Setpoints(link, clock, settings)
        self.dialogue = Dialogue(name, link, clock, settings, self.setpoints.repeat)
