"""Questions to a MAVLink vehicle and its answers: what it has told so far, and asking until it is done."""

from __future__ import annotations

from collections.abc import Callable

from drivers.errors import DriverError, SilentPortError, WrongBaudError
from drivers.mavlink_checklist import ARDUROVER_SETPOINT_TIMEOUT_S, PARAMETERS, SETPOINT_TIMEOUT
from drivers.mavlink_constants import Autopilot, Command, CommandResult
from drivers.mavlink_echo import Echo
from drivers.mavlink_link import MavlinkLink
from drivers.mavlink_modes import Modes, modes_of
from drivers.mavlink_report import VehicleReport, is_vehicle
from drivers.mavlink_settings import MavlinkSettings
from drivers.vehicle import LostVehicleError

_STEP_S = 0.02


class Dialogue:
    """Over `link` with the first vehicle that is heard there; meanwhile() is called again and again while it waits.

    name: of the vehicle, for errors. clock: returns ns.
    """

    def __init__(
        self,
        name: str,
        link: MavlinkLink,
        clock: Callable[[], int],
        settings: MavlinkSettings,
        meanwhile: Callable[[], None],
    ) -> None:
        self.report = VehicleReport()
        self._name, self._link, self._clock, self._settings = name, link, clock, settings
        self._meanwhile = meanwhile
        self._echo = Echo(round(settings.echo_s * 1e9))

    # ------------------------------------------------------------------------------------------------- what it says
    @property
    def modes(self) -> Modes:
        """The modes of its kind."""
        heartbeat = self.report.heartbeat
        return modes_of(-1 if heartbeat is None else heartbeat.autopilot)

    @property
    def mode(self) -> str:
        """The mode that it is in."""
        heartbeat = self.report.heartbeat
        return "unknown" if heartbeat is None else heartbeat.mode

    def is_guided(self) -> bool:
        """Whether it takes our setpoints."""
        return self.mode == self.modes.guided_name

    def is_armed(self) -> bool:
        """Whether its drive has power."""
        heartbeat = self.report.heartbeat
        return heartbeat is not None and heartbeat.armed

    @property
    def setpoint_timeout_s(self) -> float | None:
        """See drivers.vehicle.Vehicle."""
        told = self.report.parameters.get(SETPOINT_TIMEOUT)
        heartbeat = self.report.heartbeat
        ardupilot = heartbeat is not None and heartbeat.autopilot == Autopilot.ARDUPILOT
        return ARDUROVER_SETPOINT_TIMEOUT_S if told is None and ardupilot else told

    @property
    def unanswered_s(self) -> float:
        """For how long it has not answered whether it hears us; 0 where it never does."""
        return self._echo.unanswered_s(self._clock())

    @property
    def silent_s(self) -> float:
        """For how long there was no heartbeat."""
        heartbeat = self.report.heartbeat
        return float("inf") if heartbeat is None else (self._clock() - heartbeat.stamp_ns) * 1e-9

    # ------------------------------------------------------------------------------------------------- exchange
    def hear(self, timeout_s: float = 0.0) -> None:
        """Exchange messages; wait up to timeout_s for some."""
        link = self._link
        question = self._echo.question(self._clock()) if link.target != (0, 0) else None
        if question is not None:
            link.send("TIMESYNC", **question)
        for message in link.exchange(timeout_s):
            sender = (message.get_srcSystem(), message.get_srcComponent())
            if link.target == (0, 0) and message.get_type() == "HEARTBEAT" and is_vehicle(message):
                link.target = sender
            if sender == link.target:
                self.report.hear(message, self._clock())
                if message.get_type() == "TIMESYNC":
                    self._echo.hear(message)

    def wait(self, reached: Callable[[], bool], timeout_s: float) -> bool:
        """Exchange messages until `reached` or the time is over."""
        deadline_ns = self._clock() + round(timeout_s * 1e9)
        while not reached():
            if self._clock() >= deadline_ns:
                return False
            self.hear(_STEP_S)
            self._meanwhile()
        return True

    def await_vehicle(self) -> None:
        """Wait for the first heartbeat; SilentPortError, WrongBaudError."""
        if not self.wait(lambda: self.report.heartbeat is not None, self._settings.connect_s):
            raise self._nobody()

    def ask(self, command: Command, reached: Callable[[], bool], *parameters: float) -> bool:
        """Send a command until its effect shows in a heartbeat; False where it is refused or nothing happens."""
        if reached() and command == Command.DO_SET_MODE:
            return True
        report, answer_s = self.report, self._settings.answer_s
        for attempt in range(self._settings.attempts):
            report.answers.pop(command, None)
            self._link.command(command, *parameters, attempt=attempt)
            self.wait(lambda: reached() or command in report.answers, answer_s)
            answer = report.answers.get(command)
            if answer == CommandResult.ACCEPTED or (answer is None and reached()):
                return self.wait(reached, 2.0 * answer_s)  # the next heartbeat may be 1 s away
            if answer not in {None, CommandResult.TEMPORARILY_REJECTED, CommandResult.IN_PROGRESS}:
                return False
            self.check_heard()
        return False

    def answer(self, command: Command) -> str:
        """Return what the vehicle answered to a command, and said last, as the middle of a sentence."""
        result = self.report.answers.get(command)
        known = result in CommandResult.__members__.values()
        told = "" if result is None else f" ({CommandResult(result).name if known else f'result {result}'})"
        words = [word for word in self.report.words[-3:] if word]
        return f"{told}, it says: {'; '.join(words)}" if words else told

    def read_parameters(self) -> None:
        """Ask for the checklist's parameters, twice."""
        told = self.report.parameters
        for _ in range(2):
            for name in PARAMETERS:
                if name not in told:
                    self._link.ask_parameter(name)
                    self.hear()
            if self.wait(lambda: set(PARAMETERS) <= told.keys(), self._settings.answer_s / 2.0):
                break

    # ------------------------------------------------------------------------------------------------- errors
    @property
    def missing(self) -> str:
        """What of the vehicle has been missing for too long, a heartbeat or an answer; empty where it is not lost."""
        most_s = self._settings.lost_after_s
        if self.silent_s > most_s:
            return "heartbeat"
        return "answer" if self.unanswered_s > most_s else ""

    def check_heard(self) -> None:
        """LostVehicleError where the vehicle is silent, or does not hear us, for too long."""
        if not self.missing:
            return
        most_s = self._settings.lost_after_s
        stops = "standstill is sent, and its own timeout stops it: check link and supply, then arm again"
        if self.missing == "heartbeat":
            raise LostVehicleError(f"{self._name}: no heartbeat of the vehicle for {most_s:g} s: {stops}")
        raise LostVehicleError(
            f"{self._name}: the vehicle sends, but has answered nothing for {most_s:g} s, so it does not hear us: "
            f"{stops}"
        )

    def _nobody(self) -> DriverError:
        link, seconds, name = self._link, self._settings.connect_s, self._name
        if not link.bytes_heard:
            return SilentPortError(
                f"{name}: nothing arrives in {seconds:g} s: check wiring, address, and that the vehicle is on"
            )
        if not link.messages_heard:
            return WrongBaudError(f"{name}: what arrives is no MAVLink: check the speed, and SERIALx_PROTOCOL 2")
        return SilentPortError(f"{name}: MAVLink arrives, but no vehicle's heartbeat in {seconds:g} s")
