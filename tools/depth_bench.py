"""What depth costs: an emulated camera at its own pace through driver, thinning, projection, scan and grid.

As in a run the driver has a thread of its own, and frames wait in a queue for the one that draws.

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
from typing_extensions import Self

from drivers.d435_emulated_firmware import emulated_pinhole
from drivers.d435_emulator import D435Emulator
from drivers.depth_camera import DepthMode, open_depth_camera
from drivers.messages import DepthImage, Recordable
from mapping.depth_grid import DepthGridBuilder
from mapping.depth_projection import Projection, project
from mapping.depth_thinning import thinned
from mapping.open3d_projection import open3d_projection
from mapping.virtual_scan import ScanSettings, scan_points
from tools.config import Config
from tools.depth_simulator import SimulatedDepthCamera
from tools.emulated_camera import EmulatedCar
from tools.errors import ToolError
from tools.live_run import QUEUE_IMAGES, SensorThread
from tools.processes import memory, reset_peak, thread_times
from tools.slam_bench import Spread
from tools.solid_world import solid
from tools.stopwatch import Stopwatch
from tools.world import load_world

FloatArray = NDArray[np.float64]

STAGES = ("driver", "thinning", "projection", "scan", "grid")
_FRAMES = 45
_EVERY_NS = 100_000_000  # between two of them on the drive: a loop of 4.5 s
_WARM_UP = 3
_READER = "camera"  # the driver's thread
_PATIENCE_S = 10.0


@dataclass(frozen=True, slots=True)
class DepthCost:
    """One projection's run: cpu_share of one core, and ms of CPU time a frame, by stage.

    process_share: of the whole process in the same time; a projection may have threads of its own, which no stage
    counts. latency_ms: from a frame's stamp, which is its end in the emulator, to the grid that holds it. lost_frames:
    no buffer was free for them, or the queue was full.
    """

    projection: str
    frames: int
    lost_frames: int
    seconds: float
    cpu_share: dict[str, float]
    cpu_ms: dict[str, float]
    process_share: float
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
    """Run the camera alone for so many seconds with one of `projections`. For a process of its own."""
    frames = render(config) if rendered is None else rendered
    with DrawnCamera(name, config, frames) as camera:
        return camera.measure(seconds)


class DrawnCamera:
    """An emulated camera that streams while the block runs, and what becomes of its frames."""

    def __init__(self, name: str, config: Config, rendered: Rendered) -> None:
        self._name = name
        self._watch = Stopwatch((time.thread_time, time.perf_counter))
        self._pipeline = _Pipeline(config, rendered, projections()[name](), self._watch)
        mode = DepthMode(config.depth.width, config.depth.height, config.depth.fps)
        emulator = D435Emulator(cycle(rendered.images))
        self._camera = open_depth_camera(emulator.path, mode, calls=emulator)
        self._reader = SensorThread(self._camera, _discard, queue_scans=QUEUE_IMAGES, name=_READER)

    def __enter__(self) -> Self:
        """Load all code and fill all caches."""
        self._reader.start()
        for _ in range(_WARM_UP):
            self._pipeline.draw(self._next())
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.stop()
        self._camera.close()

    def measure(self, seconds: float) -> DepthCost:
        """Draw the frames that come in so many seconds, in this thread."""
        watch, latency = self._watch, list[float]()
        while self._reader.take(0.0) is not None:
            pass  # what has come while nobody looked
        watch.stages.clear()
        lost, reader_s, process_s = self._lost, thread_times()[_READER], time.process_time()
        reset_peak()
        began = time.monotonic()
        while time.monotonic() - began < seconds:
            image = self._next()
            self._pipeline.draw(image)
            latency.append((time.monotonic_ns() - image.stamp_ns) * 1e-9)
        took = time.monotonic() - began
        process_s = time.process_time() - process_s
        cpu = {"driver": thread_times()[_READER] - reader_s}
        cpu |= {stage: watch.stages[stage].cpu_s for stage in STAGES[1:]}
        return DepthCost(
            projection=self._name,
            frames=len(latency),
            lost_frames=self._lost - lost,
            seconds=took,
            cpu_share={stage: spent / took for stage, spent in cpu.items()},
            cpu_ms={stage: spent * 1e3 / len(latency) for stage, spent in cpu.items()},
            process_share=process_s / took,
            latency_ms=Spread.of(latency),
            peak_mb=memory().peak_mb,
        )

    @property
    def _lost(self) -> int:
        return self._camera.counters.lost_frames + self._reader.dropped_scans

    def _next(self) -> DepthImage:
        """Wait for a frame; raises ToolError where the emulated camera has none."""
        image = self._reader.take(_PATIENCE_S)
        if not isinstance(image, DepthImage):
            raise ToolError(f"no frame of the emulated camera within {_PATIENCE_S:.0f} s: {self._reader.fault}")
        return image


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


def _discard(_message: Recordable) -> None:
    """Stand in for a recorder: what that costs is not measured."""
