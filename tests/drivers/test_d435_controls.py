from __future__ import annotations

import pytest

from drivers.d435_controls import D435Controls, apply_controls, get_control
from drivers.d435_emulator import D435Emulator
from drivers.d435_hardware_monitor import Selector
from drivers.errors import DeviceFaultError
from drivers.video_device import VideoDevice


@pytest.fixture
def camera():
    return D435Emulator([])


@pytest.fixture
def device(camera):
    device = VideoDevice(camera.path, camera)
    yield device
    device.close()


def values(camera: D435Emulator) -> dict[Selector, int]:
    return {each: camera.firmware.control(each) for each in Selector if each is not Selector.HARDWARE_MONITOR}


def test_all_controls_reach_the_camera(camera, device):
    apply_controls(device, D435Controls(emitter=False, exposure_us=4000, laser_power_mw=300))
    assert values(camera) == {
        Selector.EMITTER: 0,
        Selector.EXPOSURE: 4000,
        Selector.LASER_POWER: 300,
        Selector.AUTO_EXPOSURE: 0,
    }
    assert get_control(device, Selector.EXPOSURE) == 4000


def test_the_defaults_undo_what_another_program_left(camera, device):
    apply_controls(device, D435Controls(emitter=False, exposure_us=4000))
    apply_controls(device, D435Controls())
    left = values(camera)
    assert (left[Selector.EMITTER], left[Selector.AUTO_EXPOSURE]) == (1, 1)
    assert left[Selector.LASER_POWER] == 150, "as it was"


@pytest.mark.parametrize(
    ("controls", "text"),
    [
        (D435Controls(laser_power_mw=500), "laser power 500 is out of bounds: choose 0 to 360"),
        (D435Controls(laser_power_mw=-1), "laser power -1 is out of bounds"),
        (D435Controls(exposure_us=0), "exposure 0 is out of bounds: choose 1 to 200000"),
    ],
)
def test_a_value_out_of_bounds_is_refused_by_the_camera_s_own(device, controls, text):
    with pytest.raises(DeviceFaultError, match=text):
        apply_controls(device, controls)
