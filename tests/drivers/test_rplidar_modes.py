from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import DeviceFaultError
from drivers.rplidar_channel import RplidarChannel
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8, EmulatedModel
from drivers.rplidar_modes import ScanModes, read_scan_modes
from drivers.rplidar_protocol import DeviceInfo, ScanMode


def modes_of(model: EmulatedModel, firmware: tuple[int, int] = (1, 28)) -> ScanModes:
    clock = SimulatedClock()
    device = RplidarEmulator(model, lambda times, theta: np.zeros(theta.shape))
    channel = RplidarChannel(EmulatedLink(device, clock, 115200, 115200), clock, clock.sleep)
    return read_scan_modes(channel, DeviceInfo(0x28, firmware, 7, ""))


def test_modes_as_the_device_lists_them() -> None:
    modes = modes_of(A2M8)
    assert modes.modes == A2M8.modes
    assert modes.find(None).name == "Sensitivity"
    assert modes.find("boost").id == 2


@pytest.mark.parametrize("firmware", [(1, 15), (1, 20)])
def test_old_firmware_has_two_modes(firmware: tuple[int, int]) -> None:
    modes = modes_of(A2M8, firmware)
    assert [(mode.name, mode.sample_us, mode.answer_type) for mode in modes.modes] == [
        ("Standard", 500, 0x81),
        ("Express", 250, 0x82),
    ]
    assert modes.typical.name == "Express"


def test_an_empty_list_counts_as_old_firmware() -> None:
    # Reported of an A2M6-R4 with firmware 1.27 (Slamtec/rplidar_ros#168).
    channel_modes = modes_of(replace(A2M8, modes=A2M8.modes[:2]), (1, 28))
    assert [mode.name for mode in channel_modes.modes] == ["Standard", "Express"]


def test_what_cannot_be_decoded_is_left_out_and_a_missing_range_filled_in() -> None:
    odd = (
        *A2M8.modes[:2],
        ScanMode(2, "HQ", 62.5, 12.0, 0x83),
        ScanMode(3, "Still", 0.0, 12.0, 0x84),
        ScanMode(4, "Blank", 125.0, 0.0, 0x84),
    )
    modes = modes_of(replace(A2M8, modes=odd))
    assert [mode.name for mode in modes.modes] == ["Standard", "Express", "Blank"]
    assert modes.modes[-1].max_distance_m == 12.0
    assert modes.typical.name == "Blank"  # the recommended id 3 is unusable


def test_unknown_name() -> None:
    with pytest.raises(DeviceFaultError, match="Turbo.*Standard .*, Express .*, Boost .*, Sensitivity .*, Stability "):
        modes_of(A2M8).find("Turbo")
