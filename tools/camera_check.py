"""A look at the depth camera: which nodes there are, whether they may be opened, and what a few frames are like."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from drivers.depth_discovery import DepthSearch, find_depth_nodes
from drivers.messages import DepthImage
from drivers.reconnecting_camera import ReconnectingCamera
from drivers.system_calls import LinuxSystemCalls
from tools.clock import RunClock
from tools.config import Config
from tools.live_sensors import AUTO, is_simulated_camera, open_camera

_LEAST_VALID = 0.5
_SLOW = 0.9  # of the rate that was set
_USB3_MBPS = 5000.0


@dataclass(frozen=True, slots=True)
class CameraCheck:
    """What was found. advice: what to do about it, one line each; empty where all is well.

    nodes, refused: nodes that stream depth, and why others could not be asked. valid_share: of all pixels, the mean
    over the frames; rate_hz by their stamps and numbers, lost ones included.
    """

    path: str
    simulated: bool
    nodes: list[dict[str, object]]
    refused: list[str]
    card: str
    firmware: str | None
    serial: str | None
    calibration: str
    calibration_notes: list[str]
    unit_m: float
    focal_px: float
    mode: str
    frames: int
    valid_share: float | None
    rate_hz: float | None
    counters: dict[str, int]
    advice: list[str]


def check_camera(port: str, config: Config, frames: int, sysfs: Path = Path("/sys")) -> CameraCheck:
    """Search, open the camera and look at so many frames; raises DriverError where there is none to open."""
    search = find_depth_nodes(LinuxSystemCalls(), sysfs) if port == AUTO else DepthSearch(())
    node = search.choose().path if port == AUTO else port
    with open_camera(node, config, RunClock()) as camera:
        images = _captured(camera, frames)
        shares, stamps, numbers = [], [], []
        for image in images:
            shares.append(float(np.mean(image.depth > 0)))
            stamps.append(image.stamp_ns)
            numbers.append(image.sequence)
        info = camera.info
        rate_hz = (numbers[-1] - numbers[0]) / ((stamps[-1] - stamps[0]) * 1e-9) if len(stamps) > 1 else None
        valid = float(np.mean(shares)) if shares else None
        slow = [found.path for found in search.nodes if found.usb_mbps is not None and found.usb_mbps < _USB3_MBPS]
        return CameraCheck(
            path=port if is_simulated_camera(camera) else info.path,
            simulated=is_simulated_camera(camera),
            nodes=[asdict(found) for found in search.nodes],
            refused=[str(error) for error in search.problems],
            card=info.card,
            firmware=None if info.version is None else str(info.version.firmware),
            serial=None if info.version is None else info.version.serial,
            calibration=info.calibration.source.value,
            calibration_notes=[*info.calibration.notes],
            unit_m=info.calibration.unit_m,
            focal_px=info.calibration.camera.fx,
            mode=f"{info.mode.width}x{info.mode.height} at {info.mode.fps} Hz",
            frames=len(shares),
            valid_share=valid,
            rate_hz=rate_hz,
            counters=asdict(camera.counters),
            advice=_advice(valid, rate_hz, info.mode.fps, slow, camera),
        )


def _captured(camera: ReconnectingCamera, frames: int) -> Iterator[DepthImage]:
    return islice(camera, frames) if frames else iter(())


def _advice(
    valid_share: float | None, rate_hz: float | None, fps: int, slow_nodes: list[str], camera: ReconnectingCamera
) -> list[str]:
    counters = camera.counters
    advice = [f"{path}: on USB 2: use a USB 3 port and cable for full modes" for path in slow_nodes]
    if valid_share is not None and valid_share < _LEAST_VALID:
        advice.append(f"{valid_share:.0%} of the pixels are measured: clean the lenses, step back, more light")
    if rate_hz is not None and rate_hz < _SLOW * fps:
        advice.append(f"{rate_hz:.1f} of {fps} frames a second: long exposure in the dark, or a slow USB port")
    if counters.flagged_frames or counters.short_frames:
        damaged = counters.flagged_frames + counters.short_frames
        advice.append(f"{damaged} damaged frames: use a shorter USB 3 cable or another port")
    if counters.lost_frames:
        advice.append(f"{counters.lost_frames} frames never arrived: the computer is too busy, or the USB port shared")
    return advice
