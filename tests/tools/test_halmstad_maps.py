"""Tablet maps of a building with its layout."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from tools.floor_plan import plan_lines
from tools.map_data_set import read_data_set
from tools.real_maps import halmstad_points


@pytest.mark.real_data
def test_maps_are_placed_on_the_layout_as_people_marked_them(cli, data_dir, tmp_path):
    root = data_dir / "maps_halmstad"
    outcome = cli("data-set", root / "maps/KPT4A", "-o", tmp_path / "out", "--kind", "halmstad")
    assert outcome.code == 0, outcome.err
    data = read_data_set(tmp_path / "out")
    assert [each.name for each in data.maps] == ["KPT4A_01", "KPT4A_02", "KPT4A_03", "KPT4A_04"]
    assert data.floor_plan is not None
    assert data.floor_plan.resolution_m == pytest.approx(0.02 / 1.56, rel=0.02)
    # What was marked in two maps lies in one place of the plan, but for the bends, and within the plan.
    marked = halmstad_points(root, "KPT4A_01", "KPT4A_03")
    first, third = data.maps[0], data.maps[2]
    assert first.pose is not None
    assert third.pose is not None
    shift = {each.name: _shift(each) for each in (first, third)}
    one = se2.transform_points(first.pose, marked.points_a + shift["KPT4A_01"])
    other = se2.transform_points(third.pose, marked.points_b + shift["KPT4A_03"])
    apart_m = float(np.sqrt(((one - other) ** 2).sum(axis=1).mean()))
    assert apart_m < first.warp_m + third.warp_m + 0.1
    lines = plan_lines(data.floor_plan)
    assert (one > lines.min(axis=0) - 0.5).all()
    assert (one < lines.max(axis=0) + 0.5).all()


def _shift(each) -> np.ndarray:
    """By how much a map's copy has its origin moved."""
    from mapping.map_yaml import read_map_yaml

    return np.array(read_map_yaml(each.path).origin[:2])


def test_a_folder_that_is_no_building_is_one_line(cli, tmp_path):
    (tmp_path / "F5").mkdir()
    outcome = cli("data-set", tmp_path / "F5", "-o", tmp_path / "out", "--kind", "halmstad")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "maps/BUILDING" in outcome.error_lines[0]
    assert not (tmp_path / "out").exists()
