"""Windows of one drive: no scan in both, the overlap that their band says, and the same again with the same seed."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from mapping import se2
from tools.errors import ToolError
from tools.log_windows import BAND_LIMITS, as_camera, draw_windows, map_of, thinned
from tools.pair_overlap import common_free, wall_line


@pytest.fixture(scope="module")
def windows(corridor_drive):
    return draw_windows(corridor_drive, 2, 2, np.random.default_rng(0), 120)


def test_no_scan_is_in_both_windows(windows):
    for pair in windows:
        assert len(np.intersect1d(pair.first, pair.second)) == 0


def test_each_band_has_what_was_asked_for_and_half_of_it_shares_time_at_most(windows):
    counts = Counter(pair.band for pair in windows)
    assert max(counts.values()) <= 2
    assert counts["high"] == counts[None] == 2
    shared = Counter(pair.band for pair in windows if pair.shared)
    assert max(shared.values(), default=0) <= 1


def test_the_bands_tell_the_common_free_space(windows, corridor_drive):
    for pair in windows:
        a, b = (map_of(corridor_drive, part, 0.2, se2.IDENTITY) for part in (pair.first, pair.second))
        share = common_free(a, b, se2.IDENTITY).share
        low, high = BAND_LIMITS[pair.band] if pair.band else (0.0, 0.0021)
        assert low <= share < high


def test_same_seed_same_windows(windows, corridor_drive):
    again = draw_windows(corridor_drive, 2, 2, np.random.default_rng(0), 120)
    assert [pair.first.tolist() for pair in again] == [pair.first.tolist() for pair in windows]


def test_a_short_drive_is_refused(corridor_drive):
    short = replace(corridor_drive, poses=corridor_drive.poses[:60], points=corridor_drive.points[:60])
    with pytest.raises(ToolError, match=r"corridor: 44 m driven, 56 m are needed"):
        draw_windows(short, 2, 2, np.random.default_rng(0))


def test_a_map_drawn_in_another_frame_is_the_same_map_there(corridor_drive):
    T_map_log = np.array([12.0, -7.0, 2.0])
    scans = np.arange(40)
    plain = wall_line(map_of(corridor_drive, scans, 0.05, se2.IDENTITY))
    moved = wall_line(map_of(corridor_drive, scans, 0.05, T_map_log))
    back = se2.transform_points(se2.inverse(T_map_log), moved.points)
    nearest = np.array([np.hypot(*(plain.points - point).T).min() for point in back[::20]])
    assert np.percentile(nearest, 90) < 0.08


def test_a_camera_sees_70_degrees_and_5_metres(corridor_drive):
    camera = as_camera(corridor_drive, np.random.default_rng(1))
    seen = np.vstack(camera.points)
    assert np.degrees(np.abs(np.arctan2(seen[:, 1], seen[:, 0]))).max() <= 35.0 + 1e-9
    assert camera.reach_m == 5.0
    grid = map_of(camera, np.arange(1), 0.05, se2.IDENTITY)
    rows, cols = np.nonzero(grid.known)
    far = np.hypot(*(grid.cell_centers(rows, cols) - camera.poses[0, :2]).T).max()
    assert far <= 5.0 + 0.1


def test_the_noise_of_a_camera_grows_with_the_square_of_the_range(corridor_drive):
    beam = np.column_stack([np.repeat([1.0, 4.0], 4000), np.zeros(8000)])
    drive = replace(corridor_drive, poses=corridor_drive.poses[:1], points=(beam,))
    noise = as_camera(drive, np.random.default_rng(1)).points[0][:, 0] - beam[:, 0]
    assert noise[:4000].std() == pytest.approx(0.003, rel=0.1)
    assert noise[4000:].std() == pytest.approx(0.003 * 16.0, rel=0.1)


def test_a_dense_drive_is_thinned_to_its_motion(corridor_drive):
    times = np.repeat(np.arange(len(corridor_drive.poses)), 5)
    dense = replace(
        corridor_drive, poses=corridor_drive.poses[times], points=tuple(corridor_drive.points[n] for n in times)
    )
    again = thinned(dense)
    assert np.array_equal(again.poses, corridor_drive.poses)
    assert again.points[7] is corridor_drive.points[7]
    steps = np.hypot(*np.diff(thinned(corridor_drive, 1.4, np.pi / 2.0).poses[:60, :2], axis=0).T)
    assert steps == pytest.approx(1.5)
    turning = replace(
        corridor_drive,
        poses=np.column_stack([np.zeros((119, 2)), np.radians(np.arange(119.0))]),
        points=corridor_drive.points[:119],
    )
    assert np.degrees(thinned(turning, 0.1, np.radians(9.5)).poses[:3, 2]) == pytest.approx([0.0, 10.0, 20.0])


def test_windows_of_a_dense_drive_are_judged_alike_by_fewer_scans(corridor_drive):
    """Each scan eight times over: the maps of its windows are those of the drive, whichever of the eight are taken."""
    times = np.repeat(np.arange(len(corridor_drive.poses)), 8)
    dense = replace(
        corridor_drive, poses=corridor_drive.poses[times], points=tuple(corridor_drive.points[n] for n in times)
    )
    for pair in draw_windows(dense, 1, 1, np.random.default_rng(3), 60):
        a, b = (map_of(dense, part, 0.2, se2.IDENTITY) for part in (pair.first, pair.second))
        share = common_free(a, b, se2.IDENTITY).share
        low, high = BAND_LIMITS[pair.band] if pair.band else (0.0, 0.0021)
        assert low - 0.05 <= share < high + 0.05
