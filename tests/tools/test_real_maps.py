"""Public logs and maps: read as they are, with a truth that survives mislabelled points."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from mapping import se2
from tools.errors import ToolError
from tools.real_maps import halmstad_points, read_corrected_log, read_text_grid, rigid_fit


def flaser(ranges, pose):
    return f"FLASER {len(ranges)} {' '.join(map(str, ranges))} {' '.join(map(str, pose))} 0 0 0 1.5 host 1.5\n"


def test_a_corrected_log_gives_readings_with_the_pose_after_them(tmp_path):
    text = (
        "# a comment\nODOM 0 0 0 0 0 0 1 host 1\n"
        + flaser([2.0] * 180, (1.0, 2.0, 0.5))
        + flaser([3.0] * 180, (1.0, 3.0, 0.6))
    )
    path = tmp_path / "house-corrected.log.gz"
    path.write_bytes(gzip.compress(text.encode()))
    scans = read_corrected_log(path, 15.0)
    assert scans.building == "house"
    assert scans.poses.tolist() == [[1.0, 2.0, 0.5], [1.0, 3.0, 0.6]]
    assert np.hypot(*scans.points[1].T) == pytest.approx(3.0)
    assert np.degrees(np.arctan2(*scans.points[0][0, ::-1])) == pytest.approx(-90.0)
    assert scans.travelled_m.tolist() == [0.0, 1.0]


def test_readings_of_nothing_and_of_the_housing_are_left_out(tmp_path):
    path = tmp_path / "x.log"
    path.write_text(flaser([0.0, 0.04, 78.9, 79.0, 81.9, *[1.0] * 175], (0.0, 0.0, 0.0)))
    assert len(read_corrected_log(path, 15.0).points[0]) == 176


@pytest.mark.parametrize(
    "content", [b"", b"nothing of it\n", b"FLASER 3 1.0 2.0\n", b"FLASER x\n", b"\x1f\x8b\x08broken"]
)
def test_other_files_are_one_line(tmp_path, content):
    path = tmp_path / ("x.log.gz" if content[:2] == b"\x1f\x8b" else "x.log")
    path.write_bytes(content)
    with pytest.raises(ToolError) as raised:
        read_corrected_log(path, 15.0)
    assert "\n" not in str(raised.value)


def test_a_text_grid_has_its_top_row_first(tmp_path):
    path = tmp_path / "grid.txt"
    path.write_text("0 127\n255 127\n")
    grid = read_text_grid(path, 0.1)
    assert np.sign(grid.log_odds).tolist() == [[-1.0, 0.0], [1.0, 0.0]]
    path.write_text("no numbers")
    with pytest.raises(ToolError, match="not a table"):
        read_text_grid(path, 0.1)


def test_mislabelled_points_do_not_move_a_rigid_fit():
    random = np.random.default_rng(2)
    T_a_b = np.array([3.0, -8.0, 2.5])
    points_b = random.uniform(-10.0, 10.0, (20, 2))
    points_a = se2.transform_points(T_a_b, points_b) + random.normal(0.0, 0.02, (20, 2))
    points_a[:6] = random.uniform(-10.0, 10.0, (6, 2)) + 30.0
    fit = rigid_fit(points_a, points_b, 0.5)
    assert fit.T_a_b == pytest.approx(T_a_b, abs=0.05)
    assert len(fit.points_a) == len(fit.points_b) == 14
    assert fit.residual_m < 0.05


def test_the_fit_of_exchanged_maps_is_the_inverse():
    random = np.random.default_rng(4)
    points_b = random.uniform(-10.0, 10.0, (9, 2))
    points_a = se2.transform_points(np.array([1.0, 2.0, -3.0]), points_b) + random.normal(0.0, 0.1, (9, 2))
    forth, back = rigid_fit(points_a, points_b, 1.0), rigid_fit(points_b, points_a, 1.0)
    assert se2.compose(forth.T_a_b, back.T_a_b) == pytest.approx(np.zeros(3), abs=1e-9)
    assert forth.residual_m == pytest.approx(back.residual_m)


@pytest.mark.real_data
def test_the_annotated_points_of_public_maps_fit_within_a_metre(data_dir):
    marked = halmstad_points(data_dir / "maps_halmstad", "F5_01", "F5_03")
    assert 0.04 < marked.residual_m < 1.0
    assert len(marked.points_a) >= 15
    with pytest.raises(ToolError, match="no annotation"):
        halmstad_points(data_dir / "maps_halmstad", "F5_01", "HIH_01")
