"""Two robots' maps while they drive: late overlap, no scan twice, true poses, and what cannot be made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping import se2
from tools.data_set_plan import DataSetPlan
from tools.errors import ToolError, UsageError
from tools.growing_maps import any_part, growing_maps, late_parts, versions
from tools.log_windows import map_of
from tools.pair_overlap import common_free
from tools.recorded_pairs import Drive


@pytest.fixture(scope="module")
def parts(corridor_drive):
    return late_parts(corridor_drive, np.random.default_rng(0))


def test_the_two_parts_share_no_scan_and_little_until_late(parts, corridor_drive):
    a, b = parts
    assert not set(a.numbers.tolist()) & set(b.numbers.tolist())
    shared = []
    for share in (0.35, 1.0):
        maps = []
        for part in parts:
            until = part.until(share * float(part.driven_m[-1]))
            maps.append(map_of(corridor_drive, part.numbers[:until], 0.2, se2.IDENTITY))
        shared.append(common_free(maps[0], maps[1], se2.IDENTITY).area_m2)
    assert shared[0] < 20.0
    assert shared[1] >= 50.0


def test_the_last_version_is_the_map_of_all_scans_and_each_holds_the_one_before(parts, corridor_drive):
    frame = np.array([3.0, -2.0, 1.0])
    grids = list(versions(parts[0], 0.1, frame, 10.0))
    whole = map_of(corridor_drive, parts[0].numbers, 0.1, frame)
    np.testing.assert_array_equal(grids[-1].log_odds, whole.log_odds)
    known = [np.count_nonzero(grid.known) for grid in grids]
    assert known == sorted(known)
    assert len(grids) == np.ceil(parts[0].driven_m[-1] / 10.0)


def test_same_seed_same_parts_another_seed_others(parts, corridor_drive):
    again = late_parts(corridor_drive, np.random.default_rng(0))
    other = late_parts(corridor_drive, np.random.default_rng(1))
    assert [part.numbers.tolist() for part in again] == [part.numbers.tolist() for part in parts]
    assert [part.numbers.tolist() for part in other] != [part.numbers.tolist() for part in parts]


def test_a_drive_that_is_too_short_is_refused(corridor_drive):
    short = replace(corridor_drive, poses=corridor_drive.poses[:40], points=corridor_drive.points[:40])
    with pytest.raises(ToolError, match="no two parts of 40 m"):
        late_parts(short, np.random.default_rng(0))
    with pytest.raises(ToolError, match="40 m are needed"):
        any_part(short, np.random.default_rng(0))


@pytest.fixture(scope="module")
def log(tmp_path_factory, corridor_drive):
    """The corridor's drive as a CARMEN log with corrected poses."""
    path = tmp_path_factory.mktemp("log") / "corridor.log"
    lines = []
    for pose, points in zip(corridor_drive.poses, corridor_drive.points, strict=True):
        ranges = " ".join(f"{each:.3f}" for each in np.hypot(points[:, 0], points[:, 1]))
        x, y, yaw = pose.tolist()
        place = f"{x:.4f} {y:.4f} {yaw:.5f}"
        lines.append(f"FLASER {len(points)} {ranges} {place} {place} 1.0 host 1.0\n")
    path.write_text("".join(lines))
    return path


def test_a_set_says_of_each_map_its_robot_step_and_true_pose(log, tmp_path):
    (tmp_path / "maps").mkdir()
    data = growing_maps([Drive(log)], DataSetPlan(cells_per_meter=(10.0, 20.0)), tmp_path)
    assert {each.robot: each.resolution_m for each in data.maps} == {"a": 0.1, "b": 0.05}
    assert not data.simulated
    assert "two parts of it" in data.source
    for robot in "ab":
        own = [each for each in data.maps if each.robot == robot]
        assert [each.step for each in own] == [*range(1, len(own) + 1)]
        assert len({tuple(each.pose) for each in own if each.pose is not None}) == 1
        assert all(each.path.is_file() for each in own)


def test_of_two_drives_no_map_has_a_true_pose(log, tmp_path):
    (tmp_path / "maps").mkdir()
    data = growing_maps([Drive(log), Drive(log)], DataSetPlan(cells_per_meter=(5.0,)), tmp_path)
    assert all(each.pose is None for each in data.maps)
    assert "no place in common" in data.source


def test_three_resolutions_are_a_usage_error(log, tmp_path):
    with pytest.raises(UsageError, match="3 numbers for 2 robots"):
        growing_maps([Drive(log)], DataSetPlan(cells_per_meter=(5.0, 10.0, 20.0)), tmp_path)
