"""The whole loop on simulated time: world, lidar bytes, decoder, SLAM, autopilot, vehicle link, rover, world."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
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
from drivers.vehicle import VehicleMessage, VehicleState
from mapping.grid import OccupancyGrid
from mapping.slam import MappedScan
from planning.safety import SafeCommand
from tools.autopilot import Autopilot, AutopilotState
from tools.commanded_drive import CommandedDrive
from tools.config import Config
from tools.drive_status import ENDS
from tools.pipeline import LidarDecoding, MappingFlow
from tools.simulated_car import SimulatedCar

FloatArray = NDArray[np.float64]

_TICK_NS = 50_000_000  # between commands
_READ_NS = 10_000_000
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
    """What a drive leaves for the scorer: commands, places with their stamps, and s of the last scan and pose used.

    heard_s: when the vehicle was heard last.
    """

    ticks: list[Tick] = field(default_factory=list)
    places: list[tuple[float, FloatArray]] = field(default_factory=list)
    heard_s: float | None = None
    last_scan_s: float | None = None
    last_pose_s: float | None = None


class ClosedLoop:
    """A simulated car that an autopilot drives through its link; disturb(now_s) is called every 10 ms.

    deaf_to_poses: from then on no scan gives a pose any more (as if matching failed), though scans come. drive: what
    commands the car, as on a real one. live: the map that the car makes is wanted on the way.
    """

    def __init__(
        self,
        car: SimulatedCar,
        autopilot: Autopilot,
        config: Config,
        *,
        disturb: Callable[[float], None] = lambda _: None,
        live: bool = False,
    ) -> None:
        self.log = LoopLog()
        self.deaf_to_poses = False
        self.drive = CommandedDrive(
            autopilot, car.vehicle, _TICK_NS * 1e-9, mount=config.mount(), on_message=self._hear
        )
        self._car, self._autopilot, self._disturb = car, autopilot, disturb
        self._clock = car.clock
        self._scans: EmulatedScans | None = None
        self._killed = False
        quick = config.with_slam(loop_closure=False, refine=False, scan_every=None)
        self._flow = MappingFlow(quick, config.mount(), live=live)

    def grid_now(self) -> OccupancyGrid:
        """Return the map that the car is making, with all scans so far; only of a `live` loop."""
        assert self._flow.mapper.live_grid is not None
        return self._flow.mapper.live_grid.grid()

    def unplug_lidar(self) -> None:
        """Take the lidar away."""
        assert self._scans is not None
        self._scans.unplug()

    def kill(self) -> None:
        """Let no code of ours run any more, as after SIGKILL, while the link stays up and the car goes on."""
        self._killed = True

    def run(self, most_s: float, until: Callable[[float], bool] = lambda _: False, *, after_s: float = 0.5) -> None:
        """Drive for most_s, until(now_s), or after_s longer than it took to arrive or to find no way."""
        with ExitStack() as ending:
            ending.enter_context(self._car.vehicle)
            self._scans = EmulatedScans(self._car.world, self._clock)
            self._drive(self._scans, most_s, until, round(after_s * 1e9))
            if self._killed:
                ending.pop_all()  # nobody is left who could stop the car
        self._car.world.advance(self._clock())

    def _drive(self, scans: EmulatedScans, most_s: float, until: Callable[[float], bool], after_ns: int) -> None:
        end_ns = self._clock() + round(most_s * 1e9)
        next_ns = self._clock()
        while self._clock() < end_ns and not until(self._clock() * 1e-9):
            self._disturb(self._clock() * 1e-9)
            if self._killed:
                self._car.world.advance(self._clock())
            else:
                for scan in scans.read():
                    self._take(scan)
                if self._clock() >= next_ns:
                    next_ns += _TICK_NS
                    self._tick()
                if self._autopilot.state in ENDS:
                    end_ns = min(end_ns, self._clock() + after_ns)
            self._clock.now_ns += _READ_NS

    def _take(self, scan: LaserScan) -> None:
        self.drive.note_scan(scan)
        for mapped in self._flow.feed(scan):
            self._note(mapped)

    def _note(self, mapped: MappedScan) -> None:
        stamp_s = mapped.stamp_ns * 1e-9
        self._autopilot.note_scan(stamp_s)
        self.log.last_scan_s = stamp_s
        if not self.deaf_to_poses:
            self._autopilot.add_scan(mapped)
            place = self._autopilot.place
            if place is not None:
                self.log.last_pose_s = stamp_s
                self.log.places.append((place.stamp_ns * 1e-9, place.T_map_base))

    def _hear(self, message: VehicleMessage) -> None:
        if not isinstance(message, VehicleState):  # which our end tells also of a vehicle that is silent
            self.log.heard_s = self._clock() * 1e-9

    def _tick(self) -> None:
        now_ns = self._clock()
        safe = self.drive.step(now_ns)
        step = self._autopilot.step
        progress_m = 0.0 if step is None else step.progress_m
        drives = len(self._autopilot.drives)
        following = self._autopilot.state is AutopilotState.driving and step is not None
        tick = Tick(now_ns * 1e-9, safe, drives - 1, progress_m, following, self._autopilot.state)
        self.log.ticks.append(tick)
