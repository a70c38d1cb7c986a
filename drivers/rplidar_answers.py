"""What an emulated RPLIDAR answers to requests that need no measuring: bytes in, bytes out, no state."""

from __future__ import annotations

import struct

from drivers.rplidar_models import EmulatedModel
from drivers.rplidar_protocol import (
    DEFAULT_PWM,
    FIRST_FIRMWARE_WITH_CONF,
    FIRST_FIRMWARE_WITH_SAMPLE_RATE,
    PWM_SUPPORTED,
    SYNC,
    Answer,
    Command,
    Conf,
    Descriptor,
    Health,
    checksum,
)

_COMMANDS = frozenset(Command)


def answer(model: EmulatedModel, health: Health, command: int, payload: bytes) -> bytes:
    """The answer to a question, b"" where the device stays silent: firmware that is too old, requests without one."""
    if command == Command.GET_INFO:
        major, minor = model.firmware
        return reply(Answer.INFO, bytes((model.model_id, minor, major, model.hardware)) + model.serial)
    if command == Command.GET_HEALTH:
        return reply(Answer.HEALTH, struct.pack("<BH", health.status, health.error_code))
    if command == Command.GET_SAMPLERATE and model.firmware >= FIRST_FIRMWARE_WITH_SAMPLE_RATE:
        rates = (round(model.mode_answering(kind).sample_us) for kind in (Answer.NODES, Answer.EXPRESS))
        return reply(Answer.SAMPLERATE, struct.pack("<HH", *rates))
    knows_conf = model.firmware >= FIRST_FIRMWARE_WITH_CONF
    if command == Command.GET_LIDAR_CONF and knows_conf and len(payload) >= 4:
        value = conf_entry(model, struct.unpack_from("<I", payload)[0], payload[4:])
        return b"" if value is None else reply(Answer.CONF, payload[:4] + value)
    return b""


def board_answer() -> bytes:
    """What the accessory board says of itself: it drives the motor."""
    return reply(Answer.ACC_BOARD_FLAG, struct.pack("<I", PWM_SUPPORTED))


def boot_text(model: EmulatedModel) -> bytes:
    """Undocumented text of 62 or 63 bytes, as an A2 prints it after a reset."""
    major, minor = model.firmware
    lines = (
        "RP LIDAR System.",
        f"Firmware Ver {major}.{minor} - rc2, HW Ver {model.hardware}",
        f"Model: {model.model_id:02X}",
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


def reply(kind: Answer, payload: bytes) -> bytes:
    """A single answer: its descriptor and its payload."""
    return Descriptor(len(payload), repeats=False, kind=kind).encode() + payload
