from __future__ import annotations

import numpy as np
import pytest

from fusion.evidence import TRENDS, different_places, gather
from fusion.feature_places import Matches, agreeing_matches, feature_places, match_maps
from fusion.hypotheses import SearchScale, SearchSettings, find_hypotheses
from fusion.survey import SurveyedMap, survey
from mapping import se2

FRAME = np.array([3.0, -7.0, 2.1])


@pytest.fixture(scope="module")
def pair(view) -> tuple[SurveyedMap, SurveyedMap, np.ndarray]:
    """Two views that share 6 m of 20 and 14 m, and the true pose of the second's grid in the first's."""
    a, b = survey(view(0.0, 20.0, np.zeros(3), 1)), survey(view(14.0, 28.0, FRAME, 2, 0.1))
    T_a_b = se2.compose(se2.compose(se2.inverse(a.walls.T_map_grid), se2.inverse(FRAME)), b.walls.T_map_grid)
    return a, b, T_a_b


def distance(pose: np.ndarray, truth: np.ndarray, b: SurveyedMap) -> float:
    """How far the middle of map b's walls is off."""
    middle = b.probe.points.mean(axis=0)
    return float(np.hypot(*(se2.transform_points(pose, middle) - se2.transform_points(truth, middle))))


@pytest.mark.parametrize("scales", [(SearchScale(200, 4),), (SearchScale(420, 8),), SearchSettings().scales])
def test_the_true_place_is_among_the_hypotheses(pair, scales):
    a, b, truth = pair
    settings = SearchSettings(scales)
    pool = find_hypotheses(a, b, match_maps(a, b), settings, seed=0)
    best = min(pool.poses, key=lambda pose: distance(pose, truth, b))
    assert distance(best, truth, b) < 0.05
    assert abs(np.degrees(se2.wrap_angle(best[2] - truth[2]))) < 0.3
    assert len(pool.matches) == len(pool.poses) <= settings.kept + 5


def test_places_are_found_without_any_feature(pair):
    a, b, truth = pair
    pool = find_hypotheses(a, b, Matches(np.empty((0, 2)), np.empty((0, 2))), seed=0)
    assert min(distance(pose, truth, b) for pose in pool.poses) < 0.05


def test_the_same_maps_and_seed_give_the_same_places(pair):
    a, b, _ = pair
    first, second = (find_hypotheses(a, b, match_maps(a, b), seed=4) for _ in range(2))
    assert first.poses.tobytes() == second.poses.tobytes()


def test_feature_places_follow_the_matches():
    random = np.random.default_rng(2)
    truth, other = np.array([4.0, -1.0, 0.7]), np.array([-9.0, 3.0, -2.0])
    points = random.uniform(-10.0, 10.0, (60, 2))
    moved = np.vstack([se2.transform_points(truth, points[:35]), se2.transform_points(other, points[35:])])
    matches = Matches(moved, points)
    places = feature_places(matches, seed=0)
    np.testing.assert_allclose(places[0], truth, atol=1e-6)
    np.testing.assert_allclose(places[1], other, atol=1e-6)
    assert agreeing_matches(matches, places)[:2].tolist() == [35.0, 25.0]
    assert feature_places(Matches(points[:1], points[:1]), seed=0).shape == (0, 3)


def test_the_evidence_speaks_for_the_true_place(pair):
    a, b, truth = pair
    pool = find_hypotheses(a, b, match_maps(a, b), seed=0)
    evidence = gather(a, b, pool)
    right = int(np.argmin([distance(pose, truth, b) for pose in pool.poses]))
    assert set(evidence.features) == set(TRENDS)
    for name, values in evidence.features.items():
        assert values.shape == (len(pool.poses),), name
        assert np.isfinite(values).all(), name
    assert evidence.omega[right] > 0.95
    assert int(np.argmax(evidence.features["net_middle"])) == right
    assert 0.1 < evidence.overlap(right) < 0.7


def test_different_places_are_told_by_the_middle_of_the_map_and_the_angle(pair):
    _, b, truth = pair
    middle = np.array([*b.probe.points.mean(axis=0), 0.0])
    turns = [
        np.array([0.0, 0.0, 0.05]),
        np.array([0.0, 0.0, 0.2]),
        np.array([0.8, 0.0, 0.0]),
        np.array([1.2, 0.0, 0.0]),
    ]
    moved = [se2.compose(se2.compose(se2.compose(truth, middle), turn), se2.inverse(middle)) for turn in turns]
    different = different_places(np.array([truth, *moved]), b)
    assert different[0].tolist() == [False, False, True, False, True]
    assert (different == different.T).all()
