"""Which scan modes a connected RPLIDAR offers, whatever its firmware's age."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.errors import DeviceFaultError
from drivers.rplidar_channel import RplidarChannel
from drivers.rplidar_protocol import (
    FIRST_FIRMWARE_WITH_CONF,
    FIRST_FIRMWARE_WITH_SAMPLE_RATE,
    PACKET_BYTES,
    Answer,
    Command,
    Conf,
    DeviceInfo,
    SampleRate,
    ScanMode,
    conf_request,
    conf_value,
    parse_name,
    parse_q8,
    parse_sample_rate,
    parse_u8,
    parse_u16,
    request,
)

LEGACY_EXPRESS_ID = 0
_LEGACY_MAX_DISTANCE_M = 12.0  # A2 datasheet, rev. 2.5
_LEGACY_RATE = SampleRate(standard_us=500, express_us=250)  # 2 and 4 kS/s: A2 with firmware before 1.17
_MOST_MODES = 32


@dataclass(frozen=True, slots=True)
class ScanModes:
    """The modes that can be decoded, and the one that the device recommends."""

    modes: tuple[ScanMode, ...]
    typical: ScanMode

    def find(self, name: str | None) -> ScanMode:
        """The mode of that name, in any case; None: the typical one. DeviceFaultError lists the names if none fits."""
        if name is None:
            return self.typical
        for mode in self.modes:
            if mode.name.lower() == name.lower():
                return mode
        names = ", ".join(mode.text for mode in self.modes)
        raise DeviceFaultError(f"this lidar has no scan mode {name!r}, it offers {names}: choose one of these")


def read_sample_rate(channel: RplidarChannel, info: DeviceInfo) -> SampleRate:
    """GET_SAMPLERATE, or the numbers of the data sheet for firmware that cannot tell."""
    if info.firmware < FIRST_FIRMWARE_WITH_SAMPLE_RATE:
        return _LEGACY_RATE
    answer = channel.ask(request(Command.GET_SAMPLERATE), Answer.SAMPLERATE, 4)
    rate = _LEGACY_RATE if answer is None else parse_sample_rate(answer)
    return rate if rate.standard_us and rate.express_us else _LEGACY_RATE


def read_scan_modes(channel: RplidarChannel, info: DeviceInfo) -> ScanModes:
    """Ask for the modes; firmware before 1.24, and some after it, lists none: then Standard and legacy Express."""
    if info.firmware >= FIRST_FIRMWARE_WITH_CONF:
        count = _read(channel, Conf.MODE_COUNT)
        ids = range(min(parse_u16(count, "mode count"), _MOST_MODES)) if count else ()
        modes = tuple(mode for mode in (_read_mode(channel, mode_id) for mode_id in ids) if mode is not None)
        if modes:
            answer = _read(channel, Conf.TYPICAL_MODE)
            typical_id = parse_u16(answer, "typical mode") if answer else None
            return ScanModes(modes, next((mode for mode in modes if mode.id == typical_id), modes[-1]))
    return _legacy_modes(read_sample_rate(channel, info))


def _read_mode(channel: RplidarChannel, mode_id: int) -> ScanMode | None:
    """One mode, or None if the device describes it incompletely or this driver cannot decode it."""
    sample = _read(channel, Conf.MODE_SAMPLE_US, mode_id)
    distance = _read(channel, Conf.MODE_MAX_DISTANCE, mode_id)
    answer = _read(channel, Conf.MODE_ANSWER, mode_id)
    name = _read(channel, Conf.MODE_NAME, mode_id)
    if not (sample and distance and answer and name):
        return None
    mode = ScanMode(
        id=mode_id,
        name=parse_name(name) or f"Mode{mode_id}",
        sample_us=parse_q8(sample, "sample time"),
        max_distance_m=parse_q8(distance, "maximum distance") or _LEGACY_MAX_DISTANCE_M,
        answer_type=parse_u8(answer, "answer type"),
    )
    return mode if mode.sample_us > 0 and mode.answer_type in PACKET_BYTES else None


def _read(channel: RplidarChannel, entry: Conf, mode_id: int | None = None) -> bytes | None:
    echo = struct.pack("<I", entry)
    answer = channel.ask(conf_request(entry, mode_id), Answer.CONF, attempts=2, prefix=echo)
    return None if answer is None else conf_value(answer, entry)


def _legacy_modes(rate: SampleRate) -> ScanModes:
    standard = ScanMode(0, "Standard", rate.standard_us, _LEGACY_MAX_DISTANCE_M, Answer.NODES)
    express = ScanMode(LEGACY_EXPRESS_ID, "Express", rate.express_us, _LEGACY_MAX_DISTANCE_M, Answer.EXPRESS)
    return ScanModes((standard, express), express)
