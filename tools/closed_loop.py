"""The whole loop on simulated time: world, lidar bytes, decoder, SLAM, autopilot, and the car that is commanded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import DeviceLostError
from drivers.messages import LaserScan, RawChunk
from drivers.rplidar import connect
from drivers.rplidar_emulated_scan import Ranger
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import MODELS
from mapping.slam import MappedScan
from planning.safety import SafeCommand
from tools.autopilot import Autopilot, AutopilotState
from tools.config import Config
from tools.driven_world import CommandedCar, DrivenWorld
from tools.pipeline import LidarDecoding, MappingFlow

FloatArray = NDArray[np.float64]

START_NS = 1_000_000_000
_TICK_NS = 50_000_000  # between commands
_READ_NS = 10_000_000
_AFTER_NS = 500_000_000
_MODEL = "A2M8"


class EmulatedScans:
    """Scans of an emulated RPLIDAR by its bytes, on a simulated clock that the caller moves."""

    def __init__(self, ranger: Ranger, clock: SimulatedClock) -> None:
        model = MODELS[_MODEL]
        device = RplidarEmulator(model, ranger)
        links: list[EmulatedLink] = []

        def open_link(baud: int) -> EmulatedLink:
            links.append(EmulatedLink(device, clock, model.baud, baud))
            return links[-1]

        self._clock = clock
        self._lidar = connect(open_link, clock=clock, sleep=clock.sleep)
        self._decoding = LidarDecoding()
        self._decoding.feed(self._lidar.start())
        self._link = links[-1]

    def unplug(self) -> None:
        """From now on nothing comes."""
        self._link.unplug()

    def read(self) -> list[LaserScan]:
        """Return the scans that are complete by now; none from a lidar that is lost."""
        try:
            data = self._link.read(0.0)
        except DeviceLostError:
            return []
        found = self._decoding.feed(RawChunk(self._clock(), data)) if data else []
        return [scan for scan in found if isinstance(scan, LaserScan)]


@dataclass(frozen=True, slots=True)
class Tick:
    """What was commanded when, and how far along which path, if it followed one, the follower thought the car was."""

    now_s: float
    safe: SafeCommand
    path: int
    progress_m: float
    following: bool
    state: AutopilotState


@dataclass(slots=True, eq=False)
class LoopLog:
    """What a drive leaves for the scorer: the commands, and stamps in s of the last scan and pose that were used."""

    ticks: list[Tick] = field(default_factory=list)
    last_scan_s: float | None = None
    last_pose_s: float | None = None


class ClosedLoop:
    """A car, in its world, that an autopilot drives; disturb(now_s) is called at each tick, before the command.

    deaf_to_poses: from then on no scan gives a pose any more (as if matching failed), though scans come.
    """

    def __init__(
        self,
        car: CommandedCar,
        world: DrivenWorld,
        autopilot: Autopilot,
        config: Config,
        *,
        disturb: Callable[[float], None] = lambda _: None,
    ) -> None:
        self.log = LoopLog()
        self.deaf_to_poses = False
        self._car, self._world, self._autopilot, self._disturb = car, world, autopilot, disturb
        self._clock = SimulatedClock(START_NS)
        self._scans = EmulatedScans(world, self._clock)
        quick = config.with_slam(loop_closure=False, refine=False, scan_every=None)
        self._flow = MappingFlow(quick, config.mount())

    def unplug_lidar(self) -> None:
        """Take the lidar away."""
        self._scans.unplug()

    def run(self, most_s: float, until: Callable[[float], bool] = lambda _: False) -> None:
        """Drive for most_s, until(now_s), or half a second longer than it took to arrive or to find no way."""
        end_ns = self._clock() + round(most_s * 1e9)
        next_ns = self._clock()
        while self._clock() < end_ns:
            for scan in self._scans.read():
                self._take(scan)
            if self._clock() >= next_ns:
                next_ns += _TICK_NS
                self._tick()
                if self._autopilot.state in (AutopilotState.arrived, AutopilotState.no_way):
                    end_ns = min(end_ns, self._clock() + _AFTER_NS)
                if until(self._clock() * 1e-9):
                    break
            self._clock.now_ns += _READ_NS
        self._world.advance(self._clock())

    def _take(self, scan: LaserScan) -> None:
        for mapped in self._flow.feed(scan):
            self._note(mapped)

    def _note(self, mapped: MappedScan) -> None:
        stamp_s = mapped.stamp_ns * 1e-9
        self._autopilot.note_scan(stamp_s)
        self.log.last_scan_s = stamp_s
        if not self.deaf_to_poses:
            self._autopilot.add_scan(mapped)
            if self._autopilot.place is not None:
                self.log.last_pose_s = stamp_s

    def _tick(self) -> None:
        now_ns = self._clock()
        self._disturb(now_ns * 1e-9)
        safe = self._autopilot.tick(now_ns * 1e-9)
        self._world.advance(now_ns)
        self._car.command(safe.command)
        step = self._autopilot.step
        progress_m = 0.0 if step is None else step.progress_m
        drives = len(self._autopilot.drives)
        following = self._autopilot.state is AutopilotState.driving and step is not None
        tick = Tick(now_ns * 1e-9, safe, drives - 1, progress_m, following, self._autopilot.state)
        self.log.ticks.append(tick)
