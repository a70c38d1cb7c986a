"""Candidates along a route, and chains of words through them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planning.costmap import Costmap, UnknownSpace, costmap
from planning.edges import steering
from planning.joining import Candidates, candidates, join
from planning.pieces import words_between
from planning.vehicle import Vehicle

ENDS = np.array([[1.0, 1.0, 0.0], [6.5, 1.5, np.pi / 2]])
ROUTE = np.array([[1.0, 1.0], [3.0, 3.0], [5.0, 3.0], [6.5, 1.5]])  # through the door


@pytest.fixture(scope="module")
def known(rooms) -> Costmap:
    return costmap(rooms, Vehicle(), UnknownSpace.forbidden)


def around(known: Costmap) -> tuple[Any, ...]:
    return known.blocked, known.to_blocked_m, known.grid.resolution_m, known.vehicle.corners


def placed(known: Costmap, route: np.ndarray, ends: np.ndarray) -> Candidates:
    blocked, distance_m, cell_m, corners = around(known)
    return candidates(blocked, distance_m, cell_m, corners, route, ends)


def joined(known: Costmap, along: Candidates, most_checks: int = 1000) -> np.ndarray:
    arrays = (along.poses, along.layer, along.first, along.to_go_m)
    arguments: tuple[Any, ...] = (
        *around(known),
        known.vehicle.outer_radius_m,
        *steering(known.vehicle),
        *arrays,
        most_checks,
    )
    chain: np.ndarray = join(*arguments)
    return chain


def test_candidates_fit_and_lie_along_the_route(known):
    along = placed(known, ROUTE, ENDS)
    np.testing.assert_array_equal(along.poses[[0, -1]], ENDS)
    assert known.all_fit(known.world(along.poses))
    assert (np.diff(along.layer) >= 0).all()
    for layer, (start, stop) in enumerate(zip(along.first[:-1], along.first[1:], strict=True)):
        assert (along.layer[start:stop] == layer).all()
        np.testing.assert_allclose(along.poses[start:stop, :2], along.points[[layer] * (stop - start)])
    assert (np.diff(along.to_go_m) < 0.0).all()
    assert along.to_go_m[-1] == 0.0


def test_a_chain_leads_from_the_start_to_the_goal_by_free_words(known):
    along = placed(known, ROUTE, ENDS)
    chain = joined(known, along)
    assert chain[0] == 0
    assert chain[-1] == len(along.poses) - 1
    assert (np.diff(along.layer[chain]) > 0).all()
    poses, _ = words_between(along.poses[chain], *steering(known.vehicle)).sampled(known.vehicle.turning_radius_m)
    assert known.all_fit(known.world(poses))


def test_where_a_wall_stands_the_chain_ends_before_it(known):
    straight = placed(known, np.array([[1.0, 1.0], [7.0, 1.0]]), np.array([[1.0, 1, 0], [7.0, 1, 0]]))
    chain = joined(known, straight)
    assert chain[0] == 0
    assert 3.0 < straight.poses[chain[-1], 0] < 4.0


def test_without_checks_it_stays_at_the_start(known):
    assert joined(known, placed(known, ROUTE, ENDS), 0).tolist() == [0]


def test_the_rest_after_a_candidate_numbers_the_same_poses(known):
    along = placed(known, ROUTE, ENDS)
    for begin in (0, 1, int(along.first[5]), int(along.first[6]) - 1):
        rest = along.after(begin)
        assert len(rest.first) == len(rest.to_go_m) + 1
        for number in range(len(rest.poses)):
            np.testing.assert_array_equal(rest.poses[number], along.poses[along.index_after(begin, number)])
            assert rest.layer[number] + along.layer[begin] == along.layer[along.index_after(begin, number)]
