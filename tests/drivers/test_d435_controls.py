from __future__ import annotations

import errno
import os

import pytest

from drivers import v4l2
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


def test_what_is_not_given_is_left_as_it_is(camera, device):
    apply_controls(device, D435Controls(emitter=False))
    apply_controls(device, D435Controls(emitter=None))
    assert values(camera)[Selector.EMITTER] == 0


class Unbounded:
    """The emulated camera without bounds of its controls."""

    def __init__(self, camera):
        self._camera = camera

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def ioctl(self, descriptor, request, argument):
        if argument[2] in (v4l2.UVC_GET_MIN, v4l2.UVC_GET_MAX):
            raise OSError(errno.EBADRQC, os.strerror(errno.EBADRQC))
        self._camera.ioctl(descriptor, request, argument)


def test_a_camera_that_tells_no_bounds_takes_what_fits(camera):
    device = VideoDevice(camera.path, Unbounded(camera))
    apply_controls(device, D435Controls(laser_power_mw=200))
    assert values(camera)[Selector.LASER_POWER] == 200
    with pytest.raises(DeviceFaultError, match="choose 0 to 65535"):
        apply_controls(device, D435Controls(laser_power_mw=70_000))
