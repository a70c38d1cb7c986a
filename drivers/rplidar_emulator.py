"""An RPLIDAR A2 in software, down to its bytes: what arrives on the wire goes in, what the sensor would send comes out.

No thread and no clock: the caller says what time it is. Not imitated: motor run-up (the speed changes at once, data
waits for the start-up delay), optical noise (put it into the ranger), warm-up, what health codes mean (unpublished).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.rplidar_emulated_scan import EmulatedScan, Motor, Ranger
from drivers.rplidar_models import EmulatedModel
from drivers.rplidar_protocol import (
    DEFAULT_PWM,
    MAX_PWM,
    PACKET_BYTES,
    PACKET_SAMPLES,
    PWM_SUPPORTED,
    SYNC,
    Answer,
    Command,
    Conf,
    Descriptor,
    ScanMode,
    checksum,
)

_BOOT_S = 0.03
_STALE_REQUEST_S = 0.1  # half a request is forgotten after this
_BOARD_COMMANDS = (Command.SET_PWM, Command.GET_ACC_BOARD_FLAG)  # the accessory board's: the core keeps scanning
_LEGACY_EXPRESS_ID = 0
_COMMANDS = frozenset(Command)


@dataclass(frozen=True, slots=True)
class EmulatorCounters:
    """What the emulator has produced since it was made."""

    samples_emitted: int = 0
    bytes_sent: int = 0


class RplidarEmulator:
    """A sensor of the given model whose rays go to `ranger`, with accessory board and a motor that turns from power-up.

    startup_s: from a scan request to the first sample. hz_at_default_pwm: speed at PWM 660, in proportion elsewhere.
    """

    def __init__(
        self, model: EmulatedModel, ranger: Ranger, *, startup_s: float = 0.5, hz_at_default_pwm: float = 10.0
    ) -> None:
        self.model = model
        self._ranger = ranger
        self._startup_ns = round(startup_s * 1e9)
        self._motor = Motor(DEFAULT_PWM, hz_at_default_pwm)
        self._mode: ScanMode | None = None  # requested and not stopped
        self._scan: EmulatedScan | None = None  # producing samples: needs a mode and a turning motor
        self._fault: int | None = None
        self._fault_outlives_reset = False
        self._boot_until_ns: int | None = None
        self._half_request = b""
        self._heard_ns = 0
        self._samples = 0
        self._bytes = 0

    @property
    def counters(self) -> EmulatorCounters:
        """A snapshot of the counters."""
        return EmulatorCounters(self._samples, self._bytes)

    def trip_protection(self, error_code: int, *, outlives_reset: bool = False) -> None:
        """Enter the protection stop: health reports it and scan requests are ignored until a reset."""
        self._fault, self._fault_outlives_reset = error_code, outlives_reset
        self._mode = self._scan = None

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Take request bytes, cut anywhere; return the answers. Noise, wrong checksums and unknown requests: none."""
        if now_ns - self._heard_ns > _STALE_REQUEST_S * 1e9:
            self._half_request = b""
        self._heard_ns = now_ns
        requests, self._half_request = split_requests(self._half_request + data)
        answers = b"".join(self._serve(command, payload, now_ns) for command, payload in requests)
        self._bytes += len(answers)
        return answers

    def due(self, now_ns: int) -> bytes:
        """Return what the sensor sends of its own accord up to now: the boot banner, then the scan's packets."""
        sent = b""
        if self._boot_until_ns is not None and now_ns >= self._boot_until_ns:
            self._boot_until_ns = None
            sent += self._banner()
        if self._scan is not None:
            packets = self._scan.due(now_ns)
            if len(packets) and self._mode is not None:
                self._samples += len(packets) * PACKET_SAMPLES[Answer(self._mode.answer_type)]
            sent += packets.tobytes()
        self._bytes += len(sent)
        return sent

    def _serve(self, command: int, payload: bytes, now_ns: int) -> bytes:
        if self._boot_until_ns is not None and command not in _BOARD_COMMANDS:
            return b""
        if command not in _BOARD_COMMANDS:
            self._mode = self._scan = None  # any request to the core ends a scan
        if command in (Command.SCAN, Command.FORCE_SCAN):
            forced = command == Command.FORCE_SCAN
            return self._start(self.model.mode_answering(Answer.NODES), now_ns, forced=forced)
        if command == Command.EXPRESS_SCAN:
            return self._start_express(payload, now_ns)
        if command == Command.RESET:
            self._reset(now_ns)
        elif command == Command.SET_PWM and len(payload) == 2:
            self._set_pwm(struct.unpack("<H", payload)[0], now_ns)
        return self._answer(command, payload)

    def _answer(self, command: int, payload: bytes) -> bytes:
        model = self.model
        if command == Command.GET_INFO:
            major, minor = model.firmware
            return _reply(Answer.INFO, bytes((model.model_id, minor, major, model.hardware)) + model.serial)
        if command == Command.GET_HEALTH:
            return _reply(Answer.HEALTH, struct.pack("<BH", 0 if self._fault is None else 2, self._fault or 0))
        if command == Command.GET_SAMPLERATE:
            rates = (round(model.mode_answering(kind).sample_us) for kind in (Answer.NODES, Answer.EXPRESS))
            return _reply(Answer.SAMPLERATE, struct.pack("<HH", *rates))
        if command == Command.GET_ACC_BOARD_FLAG:
            return _reply(Answer.ACC_BOARD_FLAG, struct.pack("<I", PWM_SUPPORTED))
        if command == Command.GET_LIDAR_CONF and len(payload) >= 4:
            value = conf_entry(model, struct.unpack_from("<I", payload)[0], payload[4:])
            return b"" if value is None else _reply(Answer.CONF, payload[:4] + value)
        return b""

    def _start_express(self, payload: bytes, now_ns: int) -> bytes:
        if len(payload) != 5:
            return b""
        if payload[0] == _LEGACY_EXPRESS_ID:
            return self._start(self.model.mode_answering(Answer.EXPRESS), now_ns)
        mode = next((mode for mode in self.model.modes if mode.id == payload[0]), None)
        return b"" if mode is None else self._start(mode, now_ns)

    def _start(self, mode: ScanMode, now_ns: int, *, forced: bool = False) -> bytes:
        if self._fault is not None and not forced:
            return b""
        self._mode = mode
        self._run(now_ns)
        kind = Answer(mode.answer_type)
        return Descriptor(PACKET_BYTES[kind], repeats=True, kind=kind).encode()

    def _run(self, now_ns: int) -> None:
        """Begin to sample after the start-up delay, if a scan was asked for and the motor turns."""
        if self._mode is not None and self._motor.running:
            start_ns = now_ns + self._startup_ns
            self._scan = EmulatedScan(self._mode, self.model.baud, self._motor, self._ranger, start_ns)

    def _set_pwm(self, pwm: int, now_ns: int) -> None:
        was_running = self._motor.running
        self._motor.set_pwm(min(pwm, MAX_PWM), now_ns)
        if not self._motor.running:
            self._scan = None
        elif not was_running:
            self._run(now_ns)

    def _reset(self, now_ns: int) -> None:
        self._boot_until_ns = now_ns + round(_BOOT_S * 1e9)
        if not self._fault_outlives_reset:
            self._fault = None

    def _banner(self) -> bytes:
        """Undocumented text of 62 or 63 bytes, as an A2 prints it after a reset."""
        major, minor = self.model.firmware
        lines = (
            "RP LIDAR System.",
            f"Firmware Ver {major}.{minor} - rc2, HW Ver {self.model.hardware}",
            f"Model: {self.model.model_id:02X}",
        )
        return "\r\n".join(lines).encode("ascii")


def split_requests(data: bytes) -> tuple[list[tuple[int, bytes]], bytes]:
    """Cut data into (command, payload) and the bytes of a request not complete yet; unsound bytes are skipped."""
    requests: list[tuple[int, bytes]] = []
    at = data.find(SYNC)
    while 0 <= at < len(data) - 1:
        command = data[at + 1]
        if command not in _COMMANDS:  # not a request: its second byte may begin one
            at = data.find(SYNC, at + 1)
            continue
        if not command & 0x80:
            requests.append((command, b""))
            at = data.find(SYNC, at + 2)
            continue
        if at + 3 > len(data) or at + 4 + data[at + 2] > len(data):
            break
        end = at + 4 + data[at + 2]
        sound = checksum(data[at:end]) == 0
        if sound:
            requests.append((command, data[at + 3 : end - 1]))
        at = data.find(SYNC, end if sound else at + 1)
    return requests, data[at:] if at >= 0 else b""


def conf_entry(model: EmulatedModel, entry: int, argument: bytes) -> bytes | None:
    """The value that GET_LIDAR_CONF gives for an entry, None where the device stays silent (an assumption)."""
    farthest_m = max(mode.max_distance_m for mode in model.modes)
    general = {
        Conf.ANGLE_RANGE: struct.pack("<II", 0, 360 << 8),
        Conf.DESIRED_SPEED: struct.pack("<HH", 600, DEFAULT_PWM),
        Conf.COMMAND_BITMAP: struct.pack("<I", (1 << len(model.modes)) - 1),
        Conf.MIN_ROTATION: struct.pack("<H", 300),
        Conf.MAX_ROTATION: struct.pack("<H", 900),
        Conf.MAX_DISTANCE: struct.pack("<I", round(farthest_m * 256)),
        Conf.MODE_COUNT: struct.pack("<H", len(model.modes)),
        Conf.TYPICAL_MODE: struct.pack("<H", model.typical_id),
        Conf.MAC: bytes(6),
        Conf.MODEL_REVISION: struct.pack("<H", model.hardware),
        Conf.MODEL_ALIAS: model.name.encode("ascii") + b"\0",
        Conf.DETECTED_BAUD: struct.pack("<I", model.baud),
    }
    if entry in general:
        return general[Conf(entry)]
    mode_id = struct.unpack_from("<H", argument)[0] if len(argument) >= 2 else len(model.modes)
    mode = next((mode for mode in model.modes if mode.id == mode_id), None)
    if mode is None:
        return None
    of_mode = {
        Conf.MODE_SAMPLE_US: struct.pack("<I", round(mode.sample_us * 256)),
        Conf.MODE_MAX_DISTANCE: struct.pack("<I", round(mode.max_distance_m * 256)),
        Conf.MODE_ANSWER: struct.pack("<B", mode.answer_type),
        Conf.MODE_NAME: mode.name.encode("ascii") + b"\0",
    }
    return of_mode[Conf(entry)] if entry in of_mode else None


def _reply(kind: Answer, payload: bytes) -> bytes:
    return Descriptor(len(payload), repeats=False, kind=kind).encode() + payload
