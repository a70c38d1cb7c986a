"""The RPLIDAR models that the emulator can be."""

from __future__ import annotations

from dataclasses import dataclass, replace

from drivers.rplidar_protocol import FIRST_FIRMWARE_WITH_CONF, Answer, ScanMode

_FIRST_RANGE_M = 6.0  # A2M4 datasheet
_RANGE_M = 12.0  # A2 datasheet, rev. 2.5, and A2M12 datasheet


@dataclass(frozen=True, slots=True)
class EmulatedModel:
    """Identity and modes of one model; typical_id is the recommended mode's id. Mode ids count from 0."""

    name: str
    model_id: int
    firmware: tuple[int, int]
    hardware: int
    serial: bytes
    baud: int
    modes: tuple[ScanMode, ...]
    typical_id: int

    def mode_answering(self, answer_type: int) -> ScanMode:
        """The first mode with this answer type."""
        return next(mode for mode in self.modes if mode.answer_type == answer_type)

    def with_firmware(self, firmware: tuple[int, int]) -> EmulatedModel:
        """This model with another firmware; before 1.24 it scans in the two legacy modes alone, Express at 4 kS/s."""
        if firmware >= FIRST_FIRMWARE_WITH_CONF:
            return replace(self, firmware=firmware)
        return replace(self, firmware=firmware, modes=(_STANDARD, _EXPRESS), typical_id=_EXPRESS.id)


_STANDARD = ScanMode(0, "Standard", 500.0, _RANGE_M, Answer.NODES)
_EXPRESS = ScanMode(1, "Express", 250.0, _RANGE_M, Answer.EXPRESS)

# The A2M4's firmware knows no list of modes; its revision is an assumption.
A2M4 = EmulatedModel(
    name="A2M4",
    model_id=0x24,
    firmware=(1, 20),
    hardware=2,
    serial=bytes.fromhex("A2040000000000000000000000000001"),
    baud=115200,
    modes=(
        replace(_STANDARD, max_distance_m=_FIRST_RANGE_M),
        replace(_EXPRESS, max_distance_m=_FIRST_RANGE_M),
    ),
    typical_id=1,
)
# An A2M6-R4 with firmware 1.27 has no Sensitivity mode; which of its modes it recommends is an assumption.
A2M6 = EmulatedModel(
    name="A2M6",
    model_id=0x26,
    firmware=(1, 27),
    hardware=5,
    serial=bytes.fromhex("A2060000000000000000000000000001"),
    baud=115200,
    modes=(_STANDARD, _EXPRESS, ScanMode(2, "Boost", 125.0, _RANGE_M, Answer.ULTRA)),
    typical_id=2,
)
# Modes of firmware 1.28 and 1.32 as users' logs show them; what Stability sends, and the A2M12's list beyond
# Sensitivity, are assumptions.
A2M8 = EmulatedModel(
    name="A2M8",
    model_id=0x28,
    firmware=(1, 28),
    hardware=7,
    serial=bytes.fromhex("A2080000000000000000000000000001"),
    baud=115200,
    modes=(
        _STANDARD,
        _EXPRESS,
        ScanMode(2, "Boost", 125.0, _RANGE_M, Answer.ULTRA),
        ScanMode(3, "Sensitivity", 125.0, _RANGE_M, Answer.ULTRA),
        ScanMode(4, "Stability", 125.0, _RANGE_M, Answer.ULTRA),
    ),
    typical_id=3,
)
A2M12 = EmulatedModel(
    name="A2M12",
    model_id=0x2C,
    firmware=(1, 32),
    hardware=6,
    serial=bytes.fromhex("A2120000000000000000000000000001"),
    baud=256000,
    modes=(
        _STANDARD,
        _EXPRESS,
        ScanMode(2, "Boost", 62.5, _RANGE_M, Answer.ULTRA),
        ScanMode(3, "Sensitivity", 62.5, _RANGE_M, Answer.ULTRA),
    ),
    typical_id=3,
)
MODELS = {model.name: model for model in (A2M4, A2M6, A2M8, A2M12)}


def is_emulated(serial: str) -> bool:
    """Whether a serial number (hex) is one of the emulator's, which no sensor has: its data are simulated."""
    return bytes.fromhex(serial) in {model.serial for model in MODELS.values()}
