"""An RPLIDAR A2 in software, down to its bytes: what arrives on the wire goes in, what the sensor would send comes out.

No thread and no clock: the caller says what time it is. Faults of the line are in drivers.faulty_line, those of the
optics in drivers.emulated_optics. docs/lidar-emulator.md says what is not imitated.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.emulated_faults import Fault, FaultKind, FaultScript
from drivers.emulated_optics import faulty_ranger
from drivers.rplidar_answers import answer, board_answer, boot_text, split_requests
from drivers.rplidar_emulated_scan import EmulatedScan, Motor, Ranger
from drivers.rplidar_models import EmulatedModel
from drivers.rplidar_protocol import (
    DEFAULT_PWM,
    FIRST_FIRMWARE_WITH_CONF,
    MAX_PWM,
    PACKET_BYTES,
    PACKET_SAMPLES,
    Answer,
    Command,
    Descriptor,
    Health,
    ScanMode,
)

_BOOT_S = 0.03
_STALE_REQUEST_S = 0.1  # half a request is forgotten after this
_BOARD_COMMANDS = (Command.SET_PWM, Command.GET_ACC_BOARD_FLAG)  # the accessory board's: the core keeps scanning
_LEGACY_EXPRESS_ID = 0
_PROTECTION_STOP = 2
_DRIFT_PERIOD_S = 20.0


@dataclass(frozen=True, slots=True)
class EmulatorCounters:
    """What the emulator has produced since it was made."""

    samples_emitted: int = 0
    bytes_sent: int = 0


class RplidarEmulator:
    """A sensor of the given model whose rays go to `ranger`, with a motor that turns from power-up.

    startup_s: from a scan request to the first sample. hz_at_default_pwm: speed at PWM 660, in proportion elsewhere.
    board: with the USB accessory board, which drives the motor; without it SET_PWM and GET_ACC_BOARD_FLAG meet silence.
    """

    def __init__(
        self,
        model: EmulatedModel,
        ranger: Ranger,
        *,
        startup_s: float = 0.5,
        hz_at_default_pwm: float = 10.0,
        board: bool = True,
        script: FaultScript | None = None,
    ) -> None:
        self.model = model
        self._script = script or FaultScript()
        self._ranger = faulty_ranger(ranger, self._script)
        self._startup_ns = round(startup_s * 1e9)
        drift = next(iter(self._script.of_kind(FaultKind.DRIFT)), Fault(FaultKind.DRIFT, (0.0,)))
        self._motor = Motor(DEFAULT_PWM, hz_at_default_pwm, (drift.numbers[0], drift.number(1, _DRIFT_PERIOD_S)))
        self._pwm = DEFAULT_PWM  # what was asked for; a stalled motor does not turn all the same
        self._board = board
        self._mode: ScanMode | None = None  # requested and not stopped
        self._scan: EmulatedScan | None = None  # producing samples: needs a mode and a turning motor
        self._health = Health(0, 0)
        self._fault_outlives_reset = False
        self._happened: set[Fault] = set()
        self._boot_until_ns: int | None = None
        self._half_request = b""
        self._heard_ns = 0
        self._samples = 0
        self._bytes = 0

    @property
    def counters(self) -> EmulatorCounters:
        """A snapshot of the counters."""
        return EmulatorCounters(self._samples, self._bytes)

    def power_up(self, now_ns: int) -> None:
        """Start anew, as after unplugging and plugging in; faults of its health stay."""
        self._half_request = b""
        self._mode = self._scan = None
        self._drive(DEFAULT_PWM, now_ns)
        self._boot_until_ns = now_ns + round(_BOOT_S * 1e9)

    def drive_motor(self, pwm: int, now_ns: int) -> None:
        """Drive the MOTOCTL pin of a sensor without the accessory board, 0 to 1023; 0 stops."""
        self._drive(min(pwm, MAX_PWM), now_ns)

    def trip_protection(self, error_code: int, *, outlives_reset: bool = False) -> None:
        """Enter the protection stop: health reports it and scan requests are ignored until a reset."""
        self._health, self._fault_outlives_reset = Health(2, error_code), outlives_reset
        self._mode = self._scan = None

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Take request bytes, cut anywhere; return the answers. Noise, wrong checksums and unknown requests: none."""
        self._suffer(now_ns)
        if now_ns - self._heard_ns > _STALE_REQUEST_S * 1e9:
            self._half_request = b""
        self._heard_ns = now_ns
        requests, self._half_request = split_requests(self._half_request + data)
        answers = b"".join(self._serve(command, payload, now_ns) for command, payload in requests)
        self._bytes += len(answers)
        return answers

    def due(self, now_ns: int) -> bytes:
        """Return what the sensor sends of its own accord up to now: the boot banner, then the scan's packets."""
        sent = self._suffer(now_ns)
        if self._boot_until_ns is not None and now_ns >= self._boot_until_ns:
            self._boot_until_ns = None
            sent += boot_text(self.model)
        if self._scan is not None:
            packets = self._scan.due(now_ns)
            if len(packets) and self._mode is not None:
                self._samples += len(packets) * PACKET_SAMPLES[Answer(self._mode.answer_type)]
            sent += packets.tobytes()
        self._bytes += len(sent)
        return sent

    def _suffer(self, now_ns: int) -> bytes:
        """Let happen what the script has for now; return what is sent because of it."""
        sent = b""
        for fault in self._script.of_kind(FaultKind.HEALTH, FaultKind.BANNER, FaultKind.REBOOT):
            start_ns, end_ns = self._script.span_ns(fault)
            if start_ns <= now_ns < end_ns and fault not in self._happened:
                self._happened.add(fault)
                sent += self._strike(fault)
            elif now_ns >= end_ns and fault in self._happened:
                self._happened.remove(fault)
                self._health = Health(0, 0)
        stalled = self._script.active(FaultKind.MOTOR_STALL, now_ns) is not None
        if stalled == self._motor.running and self._pwm > 0:
            self._turn(0 if stalled else self._pwm, now_ns)
        return sent

    def _strike(self, fault: Fault) -> bytes:
        if fault.kind == FaultKind.BANNER:
            return boot_text(self.model)
        if fault.kind == FaultKind.REBOOT:
            self._mode = self._scan = None
            return boot_text(self.model)
        status, code, stays = (int(number) for number in fault.numbers)
        if status == _PROTECTION_STOP:
            self.trip_protection(code, outlives_reset=bool(stays))
        else:
            self._health, self._fault_outlives_reset = Health(status, code), bool(stays)
        return b""

    def _serve(self, command: int, payload: bytes, now_ns: int) -> bytes:
        if self._script.active(FaultKind.MUTE, now_ns, Command(command).name) is not None:
            return b""
        if command in _BOARD_COMMANDS:
            return self._serve_board(command, payload, now_ns) if self._board else b""
        if self._boot_until_ns is not None:
            return b""
        self._mode = self._scan = None  # any request to the core ends a scan
        if command in (Command.SCAN, Command.FORCE_SCAN):
            forced = command == Command.FORCE_SCAN
            return self._start(self.model.mode_answering(Answer.NODES), now_ns, forced=forced)
        if command == Command.EXPRESS_SCAN:
            return self._start_express(payload, now_ns)
        if command == Command.RESET:
            self._reset(now_ns)
        return answer(self.model, self._health, command, payload)

    def _serve_board(self, command: int, payload: bytes, now_ns: int) -> bytes:
        if command == Command.GET_ACC_BOARD_FLAG:
            return board_answer()
        if len(payload) == 2:
            self._drive(min(struct.unpack("<H", payload)[0], MAX_PWM), now_ns)
        return b""

    def _start_express(self, payload: bytes, now_ns: int) -> bytes:
        if len(payload) != 5:
            return b""
        if payload[0] == _LEGACY_EXPRESS_ID:
            return self._start(self.model.mode_answering(Answer.EXPRESS), now_ns)
        lists_modes = self.model.firmware >= FIRST_FIRMWARE_WITH_CONF
        mode = next((mode for mode in self.model.modes if lists_modes and mode.id == payload[0]), None)
        return b"" if mode is None else self._start(mode, now_ns)

    def _start(self, mode: ScanMode, now_ns: int, *, forced: bool = False) -> bytes:
        if self._health.stopped and not forced:
            return b""
        self._mode = mode
        self._script.begin(now_ns)
        self._run(now_ns)
        kind = Answer(mode.answer_type)
        return Descriptor(PACKET_BYTES[kind], repeats=True, kind=kind).encode()

    def _run(self, now_ns: int) -> None:
        """Begin to sample after the start-up delay, if a scan was asked for and the motor turns."""
        if self._mode is not None and self._motor.running:
            start_ns = now_ns + self._startup_ns
            self._scan = EmulatedScan(self._mode, self.model.baud, self._motor, self._ranger, start_ns)

    def _drive(self, pwm: int, now_ns: int) -> None:
        self._pwm = pwm
        if self._script.active(FaultKind.MOTOR_STALL, now_ns) is None:
            self._turn(pwm, now_ns)

    def _turn(self, pwm: int, now_ns: int) -> None:
        was_running = self._motor.running
        self._motor.set_pwm(pwm, now_ns)
        if not self._motor.running:
            self._scan = None
        elif not was_running:
            self._run(now_ns)

    def _reset(self, now_ns: int) -> None:
        self._boot_until_ns = now_ns + round(_BOOT_S * 1e9)
        if not self._fault_outlives_reset:
            self._health = Health(0, 0)
