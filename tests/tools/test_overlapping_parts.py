"""Two parts of a drive, each at several resolutions."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.map_io import read_map
from tools.data_set_plan import DataSetPlan
from tools.overlapping_parts import overlapping_parts
from tools.pair_overlap import common_free
from tools.recorded_pairs import Drive


@pytest.fixture(scope="module")
def made(corridor_log, tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    (folder / "maps").mkdir()
    return overlapping_parts([Drive(corridor_log)], DataSetPlan((10.0, 20.0), overlap="mid"), folder)


def test_both_parts_have_each_resolution_in_a_frame_of_their_own(made):
    assert [each.name for each in made.maps] == ["a-r10", "a-r20", "b-r10", "b-r20"]
    a10, a20, b10, b20 = made.maps
    assert (a10.pose.tolist(), b10.pose.tolist()) == (a20.pose.tolist(), b20.pose.tolist())
    assert np.abs(a10.pose - b10.pose).max() > 0.1


def test_they_overlap_as_asked_at_their_true_poses(made):
    _, a, _, b = made.maps
    common = common_free(read_map(a.path), read_map(b.path), se2.between(a.pose, b.pose))
    assert 0.30 < common.share < 0.65
    assert "pairs of mid overlap" in made.source


def test_an_unknown_band_is_one_line(cli, corridor_log, tmp_path):
    outcome = cli("data-set", corridor_log, "-o", tmp_path / "out", "--kind", "parts", "--overlap", "most")
    assert outcome.code == 2
    assert "low, mid, high" in outcome.error_lines[0]
