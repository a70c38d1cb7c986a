"""The scores of the demo, against maps whose frames, drives and common part are known."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from mapping.trajectory import Trajectory, write_tum
from tools.demo_cars import CarFiles, DemoCar
from tools.demo_scores import MappedCar, read_car, score_alignment, score_common

CAR = DemoCar("A", "A2M8", "wings-west", 0.05)
RESOLUTION_M = 0.05
STAMPS_NS = np.arange(50, dtype=np.int64) * 100_000_000


def corridor(first_m: float, last_m: float) -> OccupancyGrid:
    """A stretch of a corridor along x with two walls 2 m apart, drawn in a frame at its beginning."""
    cells = np.full((42, round((last_m - first_m) / RESOLUTION_M)), -3.0, np.float32)
    cells[[0, -1]] = 3.0
    return OccupancyGrid(cells, RESOLUTION_M, np.zeros(3))


def mapped(first_m: float, last_m: float, T_corridor_world: np.ndarray) -> MappedCar:
    """A car that maps a stretch without any error: its map frame is where its drive began, 0.5 m inside."""
    drive = np.column_stack([np.linspace(0.5, 2.0, 50), np.full(50, 1.0), np.full(50, 0.1)])
    T_world_stretch = se2.compose(se2.inverse(T_corridor_world), np.array([first_m, 0.0, 0.0]))
    truth = Trajectory(STAMPS_NS, np.array([se2.compose(T_world_stretch, pose) for pose in drive]))
    return MappedCar(CAR, corridor(first_m, last_m), Trajectory(STAMPS_NS, drive), truth)


@pytest.mark.parametrize("turn", [0.0, np.pi / 2])
def test_what_two_maps_share_is_the_stretch_that_both_show(turn):
    """10 m and 12 m of a corridor, of which 3 m are in both: 3/10 of the smaller one, and two walls of 3 m."""
    T_corridor_world = np.array([3.0, -4.0, turn])
    a, b = mapped(0.0, 10.0, T_corridor_world), mapped(7.0, 19.0, T_corridor_world)
    common = score_common(a, b)
    assert common["overlap"] == pytest.approx(0.3, abs=0.01)
    assert common["free_m2"] == pytest.approx(3.0 * 2.0, abs=0.2)
    assert common["wall_m"] == pytest.approx(2 * 3.0, abs=1.0)  # with 0.25 m of tolerance at each of four ends
    assert score_common(b, a)["overlap"] == pytest.approx(common["overlap"], abs=0.01)


def pair(dx: float | None, theta_deg: float) -> dict[str, object]:
    return {"accepted": True, "reason": "", "seconds": 1.0, "dx": dx, "dy": 0.0, "theta_deg": theta_deg}


def test_the_true_pose_has_no_error_and_another_one_its_own():
    a, b = mapped(0.0, 10.0, np.zeros(3)), mapped(7.0, 19.0, np.zeros(3))
    right, beside, turned = (
        score_alignment(a, b, pair(dx, theta)) for dx, theta in ((7.0, 0.0), (7.2, 0.0), (7.0, 2.0))
    )
    assert right["rms_m"] == right["rms_between_maps_m"] == pytest.approx(0.0, abs=1e-6)
    assert right["frames_apart_m"] == pytest.approx(7.0)
    assert beside["rms_m"] == pytest.approx(0.2)
    assert turned["rotation_deg"] == pytest.approx(2.0)


def test_a_refusal_has_no_error():
    a, b = mapped(0.0, 10.0, np.zeros(3)), mapped(7.0, 19.0, np.zeros(3))
    assert score_alignment(a, b, pair(None, 0.0))["rms_m"] is None


def test_a_car_is_read_with_its_truth(tmp_path):
    files, car = CarFiles(tmp_path), mapped(0.0, 10.0, np.array([1.0, 2.0, 0.5]))
    files.live.mkdir()
    write_map(files.live / "map", car.grid)
    write_tum(files.live / "trajectory.tum", car.trajectory)
    write_tum(files.truth, car.truth)
    read = read_car(CAR, files)
    assert read.T_world_map == pytest.approx(car.T_world_map, abs=1e-6)
    assert read.T_world_drive == pytest.approx(car.T_world_map, abs=1e-6)
    assert np.array_equal(read.grid.free, car.grid.free)
