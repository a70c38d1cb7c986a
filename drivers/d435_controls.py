"""Projector and exposure of a RealSense D400 camera: settings that it keeps until it loses power."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from drivers import v4l2
from drivers.d435_hardware_monitor import DEPTH_UNIT, Selector
from drivers.errors import DeviceFaultError
from drivers.video_device import VideoDevice

_BYTES = {Selector.EMITTER: 1, Selector.EXPOSURE: 4, Selector.LASER_POWER: 2, Selector.AUTO_EXPOSURE: 1}


@dataclass(frozen=True, slots=True)
class D435Controls:
    """What to set. exposure_us: None for automatic exposure. emitter, laser_power_mw: None leaves them as they are.

    The emitter throws dots without which plain walls have no depth; a D405 has none.
    """

    emitter: bool | None = True
    exposure_us: int | None = None
    laser_power_mw: int | None = None


def apply_controls(device: VideoDevice, controls: D435Controls) -> None:
    """Set all of them; raises DeviceFaultError for a value outside the camera's bounds."""
    if controls.emitter is not None:
        set_control(device, Selector.EMITTER, int(controls.emitter))
    if controls.laser_power_mw is not None:
        set_control(device, Selector.LASER_POWER, controls.laser_power_mw)
    set_control(device, Selector.AUTO_EXPOSURE, int(controls.exposure_us is None))
    if controls.exposure_us is not None:
        set_control(device, Selector.EXPOSURE, controls.exposure_us)


def set_control(device: VideoDevice, selector: Selector, value: int) -> None:
    """Set one control within the bounds that the camera gives for it, if it does."""
    name = selector.name.lower().replace("_", " ")
    least, most = 0, (1 << 8 * _BYTES[selector]) - 1
    with contextlib.suppress(DeviceFaultError):
        least, most = (get_control(device, selector, query) for query in (v4l2.UVC_GET_MIN, v4l2.UVC_GET_MAX))
    if not least <= value <= most:
        raise DeviceFaultError(f"{device.path}: {name} {value} is out of bounds: choose {least} to {most}")
    device.write_control(DEPTH_UNIT, selector, value.to_bytes(_BYTES[selector], "little"))


def get_control(device: VideoDevice, selector: Selector, query: int = v4l2.UVC_GET_CUR) -> int:
    """Return a control's value, or one of its bounds by another query."""
    return int.from_bytes(device.read_control(DEPTH_UNIT, selector, _BYTES[selector], query), "little")
