"""The shipped recordings (simulated) through the real flow, against their golden trajectories and the truth."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.map_io import read_map
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import read_tum

NAMES = ("simulated_office_a2m8", "simulated_office_a2m12")
# Another CPU or library version rounds differently, and ICP carries that on: a tenth of the range noise is no change.
GOLDEN_M, GOLDEN_RAD = 1e-3, 1e-3
TRUTH_RMS_M, TRUTH_MAX_DEG = 0.03, 1.5


@pytest.fixture(scope="module", params=NAMES)
def replayed(request, project_root, replayed_once):
    return project_root / "recordings" / request.param, *replayed_once(request.param)


def test_trajectory_is_the_golden_one(replayed):
    stem, folder, _ = replayed
    golden, now = read_tum(stem.with_suffix(".golden.tum")), read_tum(folder / "trajectory.tum")
    assert len(golden) == len(now)
    assert np.array_equal(golden.stamps_ns, now.stamps_ns)
    off_m = np.hypot(*(golden.poses - now.poses)[:, :2].T)
    off_rad = np.abs(se2.wrap_angle(golden.poses[:, 2] - now.poses[:, 2]))
    differing = int(((off_m > GOLDEN_M) | (off_rad > GOLDEN_RAD)).sum())
    assert not differing, (
        f"{differing} of {len(now)} poses differ: position by up to {off_m.max():.4f} m (pose {off_m.argmax()}),"
        f" yaw by up to {off_rad.max():.5f} rad (pose {off_rad.argmax()})"
    )


def test_trajectory_is_close_to_the_truth(replayed):
    stem, folder, _ = replayed
    error = absolute_trajectory_error(read_tum(folder / "trajectory.tum"), read_tum(stem.with_suffix(".truth.tum")))
    assert error.poses > 200
    assert error.rms_m < TRUTH_RMS_M
    assert error.max_deg < TRUTH_MAX_DEG


def test_nothing_was_lost(replayed):
    _, _, report = replayed
    assert not report["truncated"]
    assert report["scans"]["unmatched"] == 0
    assert report["decoder"]["rejected_packets"] == 0


def test_map_lies_on_the_walls_of_the_world_and_is_not_mirrored(replayed):
    from tools.world import office

    stem, folder, _ = replayed
    grid, world = read_map(folder / "map.yaml"), office()
    error = absolute_trajectory_error(read_tum(folder / "trajectory.tum"), read_tum(stem.with_suffix(".truth.tum")))
    rows, cols = np.nonzero(grid.occupied)
    corner = world.origin[:2]

    def share_on_walls(side: float) -> float:
        points = grid.cell_centers(rows, cols) * [1.0, side]
        in_world = se2.transform_points(np.array(error.T_truth_estimate), points)
        cells = np.floor((in_world - corner) / world.resolution_m).astype(int)
        reach = 4  # 8 cm: a cell of the map and twice the range noise
        near = [
            world.occupied[
                np.clip(cells[:, 1] + dy, 0, world.occupied.shape[0] - 1),
                np.clip(cells[:, 0] + dx, 0, world.occupied.shape[1] - 1),
            ]
            for dx in range(-reach, reach + 1)
            for dy in range(-reach, reach + 1)
        ]
        return float(np.any(near, axis=0).mean())

    assert share_on_walls(1.0) > 0.99
    assert share_on_walls(-1.0) < 0.6
