"""What depth costs beside a lidar: both at the pace of the clock in one process, as on a car, on two cores.

The lidar is emulated in a process of its own and comes through its driver and the live mapping of `run`. The camera is
that of tools/depth_bench.py, in threads of its own; every frame is drawn.
"""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection

from drivers.pty_port import PtyPort
from drivers.rplidar import open_rplidar
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from mapping.slam import MappedScan
from tools.clock import RunClock
from tools.config import Config
from tools.depth_bench import DepthCost, DrawnCamera, render
from tools.emulation import Drive, simulated_lidar
from tools.errors import ToolError
from tools.live_bench import ScanLatency
from tools.live_run import LiveOutcome, run_live
from tools.pipeline import MappingFlow, search_thread, warm_up
from tools.processes import limit_to, thread_times
from tools.slam_bench import Spread

CORES = 2
_DRIVE = "office"
_PATIENCE_S = 60.0  # until the emulated lidar is there, and until its first scan is mapped
_MAPPING = threading.main_thread().name
_THREADS = {"lidar": "lidar: driver", _MAPPING: "lidar: SLAM", "slam": "lidar: loops"}


@dataclass(frozen=True, slots=True)
class LidarCost:
    """The lidar's part of the time in which the camera was measured: cpu_share of one core, by threads.

    scans: that were mapped. lost_scans: dropped before mapping, or damaged on the way. latency_ms: from a scan's last
    byte to its pose.
    """

    scans: int
    lost_scans: int
    cpu_share: dict[str, float]
    latency_ms: Spread


@dataclass(frozen=True, slots=True)
class BothCosts:
    """A camera and a lidar at once; cores: that the process had, and the lidar's emulator with it."""

    depth: DepthCost
    lidar: LidarCost
    cores: int

    @property
    def others_share(self) -> float:
        """CPU share of threads that belong to neither: those that Open3D or numpy start, above all."""
        known = sum(self.depth.cpu_share.values()) + sum(self.lidar.cpu_share.values())
        return max(self.depth.process_share - known, 0.0)


def bench_depth_beside_lidar(name: str, config: Config, seconds: float) -> BothCosts:
    """Run camera and lidar for so many seconds with one of `projections`. For a process of its own, which it limits.

    Raises DriverError or ToolError where a sensor does not come up.
    """
    cores = limit_to(CORES)
    rendered = render(config)
    warm_up()
    with emulated_lidar() as port, DrawnCamera(name, config, rendered) as camera:
        return _Both(camera, config, seconds, cores).run(port)


@contextmanager
def emulated_lidar() -> Iterator[str]:
    """Yield the port of a lidar that is emulated in another process while the block runs, on the office's tour."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs,), daemon=True)
    process.start()
    theirs.close()
    try:
        if not ours.poll(_PATIENCE_S):
            raise ToolError(f"the emulated lidar did not start within {_PATIENCE_S:.0f} s")
        yield str(ours.recv())
    finally:
        ours.close()
        process.join(_PATIENCE_S)


def _serve(parent: Connection) -> None:
    """Emulate a lidar until the other end of the connection is closed."""
    ranger = simulated_lidar(_DRIVE, Drive.tour(_DRIVE), noise=True, seed=0)
    with PtyPort(RplidarEmulator(A2M8, ranger), A2M8.baud) as port:
        parent.send(port.name)
        parent.poll(None)


class _Both:
    """One measurement: this thread maps the lidar's scans, another one draws the camera's frames."""

    def __init__(self, camera: DrawnCamera, config: Config, seconds: float, cores: int) -> None:
        self._camera = camera
        self._config = config
        self._seconds = seconds
        self._cores = cores
        self._latency = ScanLatency(sweep_reversed=False)
        self._stop = threading.Event()
        self._mapped = threading.Event()
        self._result: BothCosts | None = None
        self._failure: Exception | None = None

    def run(self, port: str) -> BothCosts:
        """Map and draw."""
        drawing = threading.Thread(target=self._draw, name="drawing")
        with open_rplidar(port, clock=RunClock()) as lidar, search_thread() as background:
            lidar.start()
            flow = MappingFlow(self._config, self._config.mount(), background=background, live=True)
            drawing.start()
            try:
                outcome = run_live(
                    lidar, flow, self._stop, put=self._latency.put, on_mapped=self._on_mapped, release=lidar.close
                )
            finally:
                self._stop.set()
                drawing.join()
        failure = outcome.fault or self._failure
        if failure is not None:
            raise failure
        if self._result is None:
            raise ToolError(f"{port}: no scan of the emulated lidar was mapped within {_PATIENCE_S:.0f} s")
        return self._with_losses(self._result, outcome)

    def _on_mapped(self, mapped: MappedScan) -> None:
        self._latency.on_mapped(mapped)
        self._mapped.set()

    def _draw(self) -> None:
        """Measure both from the lidar's first pose on, in the camera's thread."""
        try:
            if not self._mapped.wait(_PATIENCE_S):
                return
            first, before = len(self._latency.seconds), thread_times()
            depth = self._camera.measure(self._seconds)
            spent = {name: at - before.get(name, 0.0) for name, at in thread_times().items()}
            share = {label: spent.get(name, 0.0) / depth.seconds for name, label in _THREADS.items()}
            latency = self._latency.seconds[first:]
            lidar = LidarCost(len(latency), 0, share, Spread.of(latency or [float("nan")]))
            self._result = BothCosts(depth, lidar, self._cores)
        except Exception as error:  # noqa: BLE001 - raised again in the other thread
            self._failure = error
        finally:
            self._stop.set()

    def _with_losses(self, costs: BothCosts, outcome: LiveOutcome) -> BothCosts:
        damaged = sum(stream.rejected_packets for stream in outcome.streams)
        return replace(costs, lidar=replace(costs.lidar, lost_scans=outcome.dropped_scans + damaged))
