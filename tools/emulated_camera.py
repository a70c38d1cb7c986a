"""The camera of an emulated car: a D435 in software that looks at a built-in world from where the car truly is.

It lives in the process that reads it, since there is no video node to hand to another one. A car that has an emulated
lidar as well, in a process of its own, is shared through a file (`emulate lidar --car FILE`): world, drive, and the
instant at which it set out on the clock that all processes of one computer share.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.d435_emulated_firmware import emulated_pinhole
from drivers.d435_emulator import D435Emulator
from drivers.errors import PortMissingError
from drivers.wording import fault_in
from mapping.depth_projection import CameraMount
from mapping.errors import MappingError
from mapping.trajectory import Trajectory
from tools.depth_simulator import SimulatedDepthCamera
from tools.simulator import drive_along
from tools.solid_world import solid
from tools.world import TOURS, load_world

EMULATED = "emulated:"  # in front of a drive's name or a car's file, instead of a node
_START_DELAY_NS = 10**9


@dataclass(frozen=True, slots=True)
class EmulatedCar:
    """A car in a world: start_ns is when it set out, on the monotonic clock; None while it waits for that."""

    world: str
    drive: Trajectory
    start_ns: int | None = None

    @staticmethod
    def tour(name: str) -> EmulatedCar:
        """Return the car of a built-in drive."""
        world, waypoints = TOURS[name]
        return EmulatedCar(world, drive_along(waypoints))

    @staticmethod
    def read(path: Path) -> EmulatedCar:
        """Read a car's file; raises PortMissingError where there is none."""
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
            drive = Trajectory(np.array(values["stamps_ns"], np.int64), np.array(values["poses"], np.float64))
            return EmulatedCar(str(values["world"]), drive, values["start_ns"])
        except OSError as error:
            raise PortMissingError(f"{path}: no emulated car: {error.strerror}: start `emulate lidar --car`") from error
        except (ValueError, KeyError, TypeError) as error:
            raise PortMissingError(f"{path}: not the file of an emulated car: {fault_in(error)}") from error

    def write(self, path: Path) -> None:
        """Write a car's file, whole or not at all; raises OSError."""
        values = {
            "world": self.world,
            "start_ns": self.start_ns,
            "stamps_ns": self.drive.stamps_ns.tolist(),
            "poses": self.drive.poses.tolist(),
        }
        partial = path.with_name(f"{path.name}.part")
        partial.write_text(json.dumps(values), encoding="utf-8")
        partial.replace(path)


class CarView:
    """The images of a camera on an emulated car, by the instants at which they are exposed."""

    def __init__(self, car: EmulatedCar, size: tuple[int, int], mount: CameraMount, shared: Path | None = None) -> None:
        self._start_ns = car.start_ns
        self._shared = shared
        self._drive = car.drive
        self._frames = 0
        world = solid(load_world(car.world))
        self._simulated = SimulatedDepthCamera(world, car.drive, mount, camera=emulated_pinhole(size))
        self._render(0)  # loads compiled code before the stream begins
        self._frames = 0

    def __call__(self, stamp_ns: int) -> NDArray[np.uint16]:
        """Return the image that is exposed at an instant of the monotonic clock."""
        if self._start_ns is None:
            self._start_ns = (
                stamp_ns + _START_DELAY_NS if self._shared is None else EmulatedCar.read(self._shared).start_ns
            )
        since_ns = 0 if self._start_ns is None else stamp_ns - self._start_ns
        return self._render(max(since_ns, 0))

    def _render(self, since_ns: int) -> NDArray[np.uint16]:
        frame = self._simulated.frame(int(self._drive.stamps_ns[0]) + since_ns, self._frames)
        self._frames += 1
        return frame.depth


def emulated_camera(port: str, size: tuple[int, int], mount: CameraMount) -> D435Emulator:
    """Return the emulator for `emulated:DRIVE` or `emulated:FILE`; raises PortMissingError for what is neither."""
    name = port.removeprefix(EMULATED)
    shared = Path(name) if name not in TOURS else None
    car = EmulatedCar.tour(name) if shared is None else _shared_car(shared)
    try:
        return D435Emulator(CarView(car, size, mount, shared))
    except MappingError as error:
        raise PortMissingError(f"{port}: {error}") from error


def _shared_car(path: Path) -> EmulatedCar:
    if not path.is_file():
        drives = ", ".join(TOURS)
        raise PortMissingError(
            f"{EMULATED}{path}: no emulated camera: name a drive ({drives}) or what `emulate lidar --car` wrote"
        )
    return EmulatedCar.read(path)
