"""Robots' maps that grow, with registrations that are made up: what is merged, replaced, kept and told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from fusion.algorithm3 import THESIS
from fusion.alignment import Alignment
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.growing_fusion import GrowingFusion, groups_in_words
from tools.pair_cache import FinishedPair, exact_hash
from tools.pair_registration import Pair, PairRegistration, Registration
from tools.robot_folder import RobotMap

POSES = {"a": se2.IDENTITY, "b": np.array([4.0, -7.0, 1.1]), "c": np.array([-3.0, 2.0, -2.4])}
SURE = Alignment(se2.IDENTITY, True, "sure", probability=0.99, covariance=np.diag([1e-4, 1e-4, 1e-6]), conflict_m=0.0)


class MadeUp(PairRegistration):
    """Says that all robots' maps lie in one frame, but for the pairs in `elsewhere`; wall grows with the maps."""

    def __init__(self):
        super().__init__(Registration("default", THESIS, 0), None, 1, lambda _done, _count: None)
        self.elsewhere: dict[Pair, np.ndarray] = {}
        self.fusion: GrowingFusion | None = None
        self.asked: list[Pair] = []

    def finish(self, maps: Mapping[str, OccupancyGrid], pairs: Sequence[Pair]) -> dict[Pair, FinishedPair]:
        assert self.fusion is not None
        robot_of, found = self.fusion.robot_of(), {}
        for a, b in pairs:
            one, other = (robot_of[name] for name in (a, b))
            self.asked.append((one, other))
            pose = se2.between(*(POSES[name[0]] for name in (one, other)))
            if (moved := self.elsewhere.get((min(one, other), max(one, other)))) is not None:
                pose = moved if one < other else se2.inverse(moved)
            wall_m = min(maps[name].log_odds.shape[1] for name in (a, b)) * 0.5
            found[a, b] = FinishedPair(replace(SURE, T_a_b=pose, common_wall_m=wall_m), 0.1)
        return found


@pytest.fixture
def fusion():
    registration = MadeUp()
    fusion = GrowingFusion(registration)
    registration.fusion = fusion
    return fusion


def strip(width, seed=0):
    """A map of 5 m by so many cells of 0.1 m."""
    cells = np.full((50, width), -3.0, np.float32)
    cells[np.random.default_rng(seed).random(cells.shape) < 0.1] = 3.0
    return OccupancyGrid(cells, 0.1, np.zeros(3))


def robot_map(tmp_path, name, width, finished=False):
    grid = strip(width, ord(name[0]))
    return RobotMap(tmp_path / name, grid, exact_hash(grid), finished)


def drive(fusion, tmp_path, widths, names=("a", "b")):
    for width in widths:
        for name in names:
            fusion.replace(name, robot_map(tmp_path, name, width))
        fusion.settle()


def merged(fusion):
    return [pair for pair, each in fusion.pairs.items() if each.merged is not None]


def test_robots_are_merged_when_the_place_has_settled_and_their_last_maps_count(fusion, tmp_path):
    drive(fusion, tmp_path, (30, 60))
    assert merged(fusion) == []
    assert len(fusion.fused()[1].groups) == 2
    drive(fusion, tmp_path, (90, 120))
    assert merged(fusion) == [("a", "b")]
    loaded, fused = fusion.fused()
    (group,) = fused.groups
    assert sorted(grid.log_odds.shape[1] for grid in loaded.grids.values()) == [120, 120]
    assert set(group.cells.contributions) == set(loaded.name_of.values()), "nothing of earlier versions is in the map"
    poses = {number: group.T_global_map[name] for number, name in loaded.name_of.items()}
    np.testing.assert_allclose(se2.between(poses[0], poses[1]), POSES["b"], atol=1e-9)


def test_only_pairs_of_a_changed_map_are_registered_again(fusion, tmp_path):
    drive(fusion, tmp_path, (30,), "abc")
    registration = fusion.registration
    assert len(registration.asked) == 3
    registration.asked.clear()
    fusion.replace("c", robot_map(tmp_path, "c", 60))
    fusion.settle()
    assert sorted(tuple(sorted(pair)) for pair in registration.asked) == [("a", "c"), ("b", "c")]


def test_a_merge_that_a_later_version_contradicts_is_withdrawn_and_told(fusion, tmp_path):
    drive(fusion, tmp_path, (30, 60, 90, 120))
    fusion.registration.elsewhere["a", "b"] = np.array([20.0, 0.0, 0.0])
    drive(fusion, tmp_path, (150,))
    assert merged(fusion) == []
    _, fused = fusion.fused()
    assert len(fused.groups) == 2
    (pair,) = fused.details["growing"]
    assert not pair["merged"]
    assert "another place" in pair["withdrawn"]


def test_a_robot_that_starts_again_keeps_its_former_map_and_earns_its_place_anew(fusion, tmp_path):
    drive(fusion, tmp_path, (30, 60, 90, 120))
    former = fusion.robots["b"]
    name = fusion.restarted("b", former, robot_map(tmp_path, "b", 35))
    assert name == "b before its start 2"
    fusion.settle()
    assert ("a", name) in merged(fusion)
    assert ("a", "b") not in merged(fusion)
    _, fused = fusion.fused()
    assert sorted(len(group.T_global_map) for group in fused.groups) == [1, 2]
    assert fusion.restarted("b", fusion.robots["b"], robot_map(tmp_path, "b", 20)) == "b before its start 3"


def test_what_stops_half_way_leaves_the_pairs_as_they_were_and_is_made_up_for(fusion, tmp_path):
    drive(fusion, tmp_path, (30,))
    before = dict(fusion.pairs)
    finish = fusion.registration.finish

    def interrupted(_maps, _pairs):
        raise KeyboardInterrupt

    fusion.registration.finish = interrupted
    with pytest.raises(KeyboardInterrupt):
        drive(fusion, tmp_path, (60,))
    assert fusion.pairs == before
    fusion.registration.finish = finish
    fusion.settle()
    assert len(fusion.pairs["a", "b"].versions) == 2


def test_finished_maps_are_judged_as_they_are(fusion, tmp_path):
    for name in "ab":
        fusion.replace(name, robot_map(tmp_path, name, 60, finished=True))
    fusion.settle()
    assert merged(fusion) == [("a", "b")]


def test_two_robots_with_one_map_are_one_map(fusion, tmp_path):
    both = robot_map(tmp_path, "a", 60)
    fusion.replace("a", both)
    fusion.replace("b", both)
    fusion.settle()
    loaded, fused = fusion.fused()
    assert len(fused.groups) == 1
    assert len(loaded.maps) == 1


def test_the_state_in_words(fusion, tmp_path):
    drive(fusion, tmp_path, (30, 60, 90, 120))
    fusion.replace("c", robot_map(tmp_path, "c", 40))
    fusion.settle()
    words = groups_in_words(fusion.structure(), fusion.robot_of())
    assert words in {"one map: a + b; apart: c", "one map: b + a; apart: c"}
