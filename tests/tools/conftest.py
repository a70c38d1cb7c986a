"""The command line in this process or in one of its own, and an emulated car to map."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from mapping.raycast import cast_rays
from mapping.trajectory import Trajectory, write_tum
from tools.cli import main
from tools.drive_bench import WORLD, Bench, Mapped
from tools.fused_set import fuse_set
from tools.group_fusion import CACHE_NAME
from tools.log_windows import PosedScans
from tools.map_data_set import DataSetMap, FloorPlan, MapDataSet, write_data_set
from tools.simulated_drive import record_round_trip
from tools.world import load_world


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def error_lines(self) -> list[str]:
        """The lines on stderr that the error boundary printed."""
        return [line for line in self.err.splitlines() if line.startswith("mapfuse-robot: ")]


Cli = Callable[..., Outcome]


@pytest.fixture(scope="session")
def exact_bench() -> Bench:
    """Drives in the office, on a map that is made from the world itself, without error."""
    world, resolution_m = load_world(WORLD), 0.05
    rows, cols = np.nonzero(world.occupied)
    scale = world.resolution_m / resolution_m
    height, width = (int(np.ceil(size * scale)) for size in world.occupied.shape)
    cells = np.full((height, width), -5.0, np.float32)
    cells[(rows * scale).astype(int), (cols * scale).astype(int)] = 5.0
    grid = OccupancyGrid(cells, resolution_m, world.origin)
    return Bench(Mapped(grid, np.zeros((1, 3)), np.zeros(3)), 3)


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Run a command in this process."""

    def run(*arguments: str | os.PathLike[str]) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["mapfuse-robot", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        printed = capsys.readouterr()
        return Outcome(int(end.value.code or 0), printed.out, printed.err)

    return run


class Spawned:
    """A command in a process of its own, which Ctrl-C ends."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tools.cli", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def event(self, wanted: str) -> dict[str, object]:
        """Wait for an event of an emulator."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            event: dict[str, object] = json.loads(line)
            if event["event"] == wanted:
                return event
        raise AssertionError(f"ended before {wanted}: {self.process.communicate()[1]}")

    def end(self, number: int = signal.SIGINT) -> Outcome:
        """Send a signal and wait."""
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=60)
        return Outcome(self.process.returncode, out, err)


@pytest.fixture
def spawn(project_root: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Spawned]]:
    """Start commands in processes of their own; those that still run at the end of the test are ended."""
    monkeypatch.setenv("PYTHONPATH", str(project_root))
    with ExitStack() as cleanup:

        def start(*arguments: str | os.PathLike[str]) -> Spawned:
            spawned = Spawned([str(argument) for argument in arguments])
            cleanup.callback(_finish, spawned.process)
            return spawned

        yield start


def _finish(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.kill()
    process.communicate()


@pytest.fixture(scope="session")
def round_trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 40 turns of a simulated A2 in the office, only to be read."""
    path = tmp_path_factory.mktemp("round_trip") / "drive.mcap"
    record_round_trip(path, 40)
    return path


@pytest.fixture(scope="session")
def corridor_drive() -> PosedScans:
    """A drive of 178 m in a building of its own: a corridor with niches, up and down, a scan each 0.75 m."""
    random = np.random.default_rng(5)
    occupied = np.ones((160, 1010), np.bool_)  # 0.1 m a cell
    occupied[60:85, 10:1000] = False
    for left in range(20, 970, 40):
        width, depth = random.integers(10, 25), random.integers(10, 40)
        side = slice(85, 85 + depth) if random.random() < 0.5 else slice(60 - depth, 60)
        occupied[side, left : left + width] = False
    way = np.concatenate([np.arange(5.0, 94.25, 0.75), np.arange(94.25, 5.0, -0.75)])
    heading = np.repeat([0.0, np.pi], len(way) // 2)
    poses = np.column_stack([way, np.full(len(way), 7.2), heading])
    beams = np.linspace(-np.pi / 2.0, np.pi / 2.0, 181)
    directions = np.column_stack([np.cos(beams), np.sin(beams)])
    points = []
    for x, y, yaw in poses.tolist():
        starts = np.tile([x / 0.1, y / 0.1], (len(beams), 1))
        ranges = cast_rays(occupied, starts, beams + yaw, 1000.0) * 0.1
        points.append(directions * (ranges + random.normal(0.0, 0.005, len(ranges)))[:, np.newaxis])
    return PosedScans("corridor", poses, tuple(points), 15.0)


@pytest.fixture(scope="session")
def corridor_log(corridor_drive: PosedScans, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive in the corridor as a corrected CARMEN log of 181 beams, only to be read."""
    lines = []
    for pose, points in zip(corridor_drive.poses, corridor_drive.points, strict=True):
        ranges = " ".join(f"{value:.3f}" for value in np.hypot(*points.T))
        at = " ".join(f"{value:.6f}" for value in pose)
        lines.append(f"FLASER 181 {ranges} {at} {at} 1.0 host 1.0")
    path = tmp_path_factory.mktemp("log") / "hall-corrected.log"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="session")
def box_set(tmp_path_factory: pytest.TempPathFactory) -> MapDataSet:
    """Simulated maps of boxes on 6 m x 5 m at 10 and 20 cells/m, the second rate with holes in the free space."""
    image = np.full((100, 120), 255, np.uint8)
    for x, y, width, height in np.random.default_rng(5).integers([3, 3, 4, 4], [110, 90, 20, 20], (22, 4)).tolist():
        cv2.rectangle(image, (x, y), (x + width, y + height), 0, 2)
    folder, maps = tmp_path_factory.mktemp("boxes"), []
    for k in (1, 2):
        cells = np.where(image > 0, -5.0, 5.0)
        if k == 2:
            cells[np.random.default_rng(1).random(cells.shape) < 0.02] = 0.0
        for r, every in ((10.0, 2), (20.0, 1)):
            grid = OccupancyGrid(cells[::every, ::every].astype(np.float32), 1.0 / r, np.zeros(3))
            files = write_map(folder / f"r{r:g}-k{k}", grid)
            maps.append(DataSetMap(f"r{r:g}-k{k}", files.lossless, 1.0 / r, 2.5 / k, k, "car", pose=np.zeros(3)))
    data = MapDataSet(folder, "boxes", "Simulated data: drawn boxes.", True, tuple(maps), "heterogeneous")
    write_data_set(data)
    return data


ROOMS_POSE = np.array([6.0, -3.0, 2.2])
RoomsPart = Callable[..., OccupancyGrid]


@pytest.fixture(scope="session")
def rooms_part() -> RoomsPart:
    """A function that cuts columns (of 320, 0.05 m each) out of a floor seen with noise, its frame at a pose."""
    image = np.full((240, 320), 255, np.uint8)
    random = np.random.default_rng(3)
    cv2.rectangle(image, (0, 0), (319, 239), 0, 2)
    for x in (90, 150, 260):
        cv2.line(image, (x, 0), (x, 90), 0, 2)
    cv2.line(image, (60, 130), (319, 130), 0, 2)
    cv2.line(image, (130, 130), (145, 130), 255, 3)
    for _ in range(45):
        x, y, width, height = random.integers([5, 5, 4, 4], [310, 230, 20, 20]).tolist()
        cv2.rectangle(image, (x, y), (x + width, y + height), 0, 2)

    def cut(seed: int, first: int = 0, last: int = 320, frame: np.ndarray = se2.IDENTITY) -> OccupancyGrid:
        cells = np.where(image > 0, -5.0, 5.0)
        cells[np.random.default_rng(seed).random(cells.shape) < 0.01] = 0.0
        origin = se2.compose(frame, np.array([first * 0.05, 0.0, 0.0]))
        return OccupancyGrid(cells[:, first:last].astype(np.float32), 0.05, origin)

    return cut


ROOMS_FRAMES = {"west": np.zeros(3), "mid": np.array([4.0, -7.0, 1.1]), "east": np.array([-3.0, 2.0, -2.4])}


@pytest.fixture(scope="session")
def rooms_set(tmp_path_factory: pytest.TempPathFactory, rooms_part: RoomsPart) -> MapDataSet:
    """Simulated maps of three robots in the rooms, of a window each, with their drives, and the rooms' floor plan."""
    folder, maps = tmp_path_factory.mktemp("rooms"), []
    (folder / "maps").mkdir()
    windows = {"west": (0, 200), "mid": (50, 290), "east": (110, 320)}
    for seed, (name, frame) in enumerate(ROOMS_FRAMES.items()):
        first, last = windows[name]
        files = write_map(folder / "maps" / name, rooms_part(seed, first, last, frame))
        way = np.column_stack([np.linspace(first + 20, last - 20, 30) * 0.05, np.full(30, 5.6), np.zeros(30)])
        track = files.lossless.with_suffix(".tum")
        write_tum(track, Trajectory(np.arange(30) * 10**9, se2.compose(frame, way)))
        maps.append(DataSetMap(name, files.lossless, 0.05, robot=name, pose=se2.inverse(frame), trajectory=track))
    walls = np.flipud(rooms_part(9).log_odds > 0.0)
    cv2.imwrite(str(folder / "plan.png"), np.where(walls, 0, 255).astype(np.uint8))
    plan = FloorPlan(folder / "plan.png", 0.05, np.zeros(3))
    data = MapDataSet(folder, "rooms", "Simulated data: drawn rooms.", True, tuple(maps), "robots", plan)
    write_data_set(data)
    return data


@pytest.fixture(scope="session")
def rooms_pairs(rooms_set: MapDataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The finished registrations of these maps by the default method, to be copied to where `fuse` would keep them."""
    folder = tmp_path_factory.mktemp("rooms_fused")
    fuse_set(rooms_set, "default", 0, 1, folder)
    return folder / CACHE_NAME


@pytest.fixture(scope="session")
def rooms_parts(tmp_path_factory: pytest.TempPathFactory, rooms_part: RoomsPart) -> MapDataSet:
    """Simulated maps of two parts of the rooms that overlap, each at 20 and 10 cells/m."""
    folder, maps = tmp_path_factory.mktemp("parts"), []
    for robot, seed, window, frame in (("a", 1, (0, 220), se2.IDENTITY), ("b", 2, (90, 320), ROOMS_POSE)):
        fine = rooms_part(seed, *window, frame)
        for r, every in ((10.0, 2), (20.0, 1)):
            files = write_map(
                folder / f"{robot}-r{r:g}", OccupancyGrid(fine.log_odds[::every, ::every], 1.0 / r, fine.origin)
            )
            maps.append(DataSetMap(files.lossless.stem, files.lossless, 1.0 / r, robot=robot, pose=se2.inverse(frame)))
    data = MapDataSet(folder, "parts", "Simulated data: drawn rooms.", True, tuple(maps), "parts")
    write_data_set(data)
    return data


@pytest.fixture
def two_maps(tmp_path: Path, rooms_part: RoomsPart) -> tuple[Path, Path]:
    """YAML files of two halves that share a third of the floor; the second's origin is rotated, as nav2 allows."""
    write_map(tmp_path / "a", rooms_part(1, 0, 220))
    write_map(tmp_path / "b", rooms_part(2, 90, 320, ROOMS_POSE))
    return tmp_path / "a.yaml", tmp_path / "b.yaml"


@pytest.fixture
def true_pose() -> np.ndarray:
    """Where the second of the two maps' frame is in the first one's."""
    return se2.inverse(ROOMS_POSE)
