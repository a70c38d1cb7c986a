"""What depth costs: an emulated camera at its own pace through driver, thinning, projection, scan and grid.

Frames are rendered beforehand and looped, so that no time goes into them but the emulator's copy of each into its
buffer, which a real camera leaves to the USB controller; it counts as the driver's. Every frame is drawn, which a run
does only while the car moves fast.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from drivers.d435_emulated_firmware import emulated_pinhole
from drivers.d435_emulator import D435Emulator
from drivers.depth_camera import DepthMode, open_depth_camera
from drivers.messages import DepthImage
from mapping.depth_grid import DepthGridBuilder
from mapping.depth_projection import Projection, project
from mapping.depth_thinning import thinned
from mapping.open3d_projection import open3d_projection
from mapping.virtual_scan import ScanSettings, scan_points
from tools.config import Config
from tools.depth_simulator import SimulatedDepthCamera
from tools.emulated_camera import EmulatedCar
from tools.own_process import memory, reset_peak
from tools.slam_bench import Spread
from tools.solid_world import solid
from tools.stopwatch import Stopwatch
from tools.world import load_world

FloatArray = NDArray[np.float64]

STAGES = ("driver", "thinning", "projection", "scan", "grid")
_FRAMES = 45
_EVERY_NS = 100_000_000  # between two of them on the drive: a loop of 4.5 s
_WARM_UP = 3


@dataclass(frozen=True, slots=True)
class DepthCost:
    """One projection's run: cpu_share of one core, and ms of CPU time a frame, by stage.

    latency_ms: from a frame's stamp, which is its end in the emulator, to the grid that holds it. lost_frames: no
    buffer was free for them.
    """

    projection: str
    frames: int
    lost_frames: int
    seconds: float
    cpu_share: dict[str, float]
    cpu_ms: dict[str, float]
    latency_ms: Spread
    peak_mb: float


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """Frames with the poses (N, 3) of the car at them."""

    images: list[NDArray[np.uint16]]
    poses: FloatArray


def render(config: Config) -> Rendered:
    """Return frames along the beginning of the office's tour, as the emulated camera sees it."""
    car = EmulatedCar.tour("office")
    size = (config.depth.width, config.depth.height)
    camera = SimulatedDepthCamera(
        solid(load_world(car.world)), car.drive, config.camera_mount(), camera=emulated_pinhole(size)
    )
    stamps = np.arange(_FRAMES, dtype=np.int64) * _EVERY_NS
    return Rendered(
        [camera.frame(stamp, number).depth for number, stamp in enumerate(stamps.tolist())], car.drive.at(stamps)
    )


def projections() -> dict[str, Callable[[], Projection]]:
    """Return what can be measured here: numpy's projection, and Open3D's where it can be loaded."""
    found: dict[str, Callable[[], Projection]] = {"numpy": lambda: project}
    try:
        open3d_projection()
    except (ImportError, OSError):
        return found
    return {**found, "open3d": open3d_projection}


def bench_depth(name: str, config: Config, seconds: float, rendered: Rendered | None = None) -> DepthCost:
    """Run the camera for so many seconds with one of `projections`. For a process of its own."""
    frames = render(config) if rendered is None else rendered
    projection = projections()[name]()
    mode = DepthMode(config.depth.width, config.depth.height, config.depth.fps)
    emulator = D435Emulator(cycle(frames.images))
    watch, latency = Stopwatch(), list[float]()
    pipeline = _Pipeline(config, frames, projection, watch)
    with open_depth_camera(emulator.path, mode, calls=emulator) as camera:
        stream = iter(camera)
        for _ in range(_WARM_UP):
            pipeline.draw(next(stream))
        watch.stages.clear()
        lost, count = camera.counters.lost_frames, 0
        reset_peak()
        began = time.monotonic()
        while time.monotonic() - began < seconds:
            with watch.stage("driver"):
                image = next(stream)
            pipeline.draw(image)
            latency.append((time.monotonic_ns() - image.stamp_ns) * 1e-9)
            count += 1
        took = time.monotonic() - began
        lost = camera.counters.lost_frames - lost
    cpu = {stage: watch.stages[stage].cpu_s for stage in STAGES}
    return DepthCost(
        projection=name,
        frames=count,
        lost_frames=lost,
        seconds=took,
        cpu_share={stage: spent / took for stage, spent in cpu.items()},
        cpu_ms={stage: spent * 1e3 / count for stage, spent in cpu.items()},
        latency_ms=Spread.of(latency),
        peak_mb=memory().peak_mb,
    )


class _Pipeline:
    """The stages of a frame, each timed."""

    def __init__(self, config: Config, frames: Rendered, projection: Projection, watch: Stopwatch) -> None:
        self._settings = ScanSettings(bottom_m=config.depth.bottom_m, top_m=config.depth.top_m)
        self._mount = config.camera_mount()
        self._builder = DepthGridBuilder(config.grid.resolution_m, config.depth_model())
        self._poses = frames.poses
        self._projection = projection
        self._watch = watch

    def draw(self, image: DepthImage) -> None:
        """Take a frame from pixels to the grid."""
        with self._watch.stage("thinning"):
            small = thinned(image, self._settings.thinning)
        with self._watch.stage("projection"):
            points = self._projection(small, self._mount)
        with self._watch.stage("scan"):
            scan = scan_points(points, image.stamp_ns, image.camera, self._mount, self._settings)
        with self._watch.stage("grid"):
            self._builder.add_scan(self._poses[image.sequence % len(self._poses)], scan)
