"""What report.json says of maps, groups and robots."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.algorithm3 import THESIS
from fusion.map_set import MapSet
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from mapping.trajectory import Trajectory, write_tum
from tools.fused_groups import FusedGroups, global_maps
from tools.fusion_report import find_robots, fusion_report
from tools.map_files import read_maps
from tools.pair_registration import PairRegistration, Registration


@pytest.fixture
def told(tmp_path):
    """The report of a map with a robot, one whose robot is unreadable, and a file that is no map."""
    for number, name in enumerate(("a", "b")):
        cells = np.full((20 + 10 * number, 20), -2.0, np.float32)
        write_map(tmp_path / name, OccupancyGrid(cells, 0.05, np.zeros(3)))
    drive = Trajectory(np.array([10**9, 2 * 10**9], np.int64), np.array([[0.1, 0.1, 0.0], [0.8, 0.5, 1.0]]))
    write_tum(tmp_path / "a.tum", drive)
    (tmp_path / "b.tum").write_text("no poses\n")
    (tmp_path / "c.yaml").write_text("nothing")
    loaded = read_maps([tmp_path / f"{name}.yaml" for name in "abc"])
    maps = MapSet().added(loaded.maps)
    fused = FusedGroups(global_maps(maps, maps.structure()), {})
    registration = Registration("default", THESIS, 7)
    pairs = PairRegistration(registration, None, 1, lambda _done, _count: None)
    return fusion_report(loaded, fused, find_robots(loaded, fused), registration, pairs)


def test_maps_have_their_group_and_skipped_ones_the_reason(told):
    assert [entry["group"] for entry in told["maps"]] == [1, 0, None]
    assert "c.yaml" in told["maps"][2]["skipped"]
    assert [len(group["files"]) for group in told["groups"]] == [1, 1]
    assert (told["seed"], told["method"], told["registrations"]["all_pairs"]) == (7, "default", 1)


def test_robots_are_where_their_maps_are(told):
    a, b = told["robots"]
    assert (a["group"], a["stamp_s"], a["poses"]) == (1, 2.0, "global_1_a.tum")
    np.testing.assert_allclose(a["T_global_robot"], [0.8, 0.5, 1.0])
    assert b["group"] is None
    assert "b.tum" in b["skipped"]
