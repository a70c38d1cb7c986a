"""The whole of Algorithm 3 on views of a drawn floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.algorithm3 import (
    ALPHAS,
    THESIS,
    TOLERANT,
    FloatArray,
    match_maps,
    register_by_features,
    register_with_seeds,
)
from fusion.alignment import Alignment
from fusion.errors import FusionError
from fusion.evaluation import alignment_error
from fusion.features import FeatureMethod
from mapping import se2
from mapping.grid import OccupancyGrid

FRAMES = [np.array([3.0, -7.0, 2.1]), np.array([-15.0, 4.0, -0.7]), np.array([0.0, 12.0, np.pi / 2])]


def pose_of(found: Alignment) -> FloatArray:
    """The pose of an alignment that must have one."""
    assert found.T_a_b is not None, found.reason
    return found.T_a_b


def grid_of(values: list[list[float]]) -> OccupancyGrid:
    return OccupancyGrid(np.array(values, dtype=np.float32), 0.05, np.zeros(3))


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize(("resolution_a", "resolution_b"), [(0.05, 0.05), (0.04, 0.08)])
def test_finds_the_pose_of_overlapping_views(view, frame, resolution_a, resolution_b):
    a = view(0.0, 20.0, np.array([1.0, 2.0, 0.3]), 1, resolution_a)
    b = view(9.0, 30.0, frame, 2, resolution_b)
    truth = se2.compose(np.array([1.0, 2.0, 0.3]), se2.inverse(frame))
    found = register_by_features(a, b, TOLERANT)
    assert found.accepted, found.reason
    error = alignment_error(a, b, pose_of(found), truth)
    assert error.rms_m < 0.10
    assert error.rotation_deg < 1.0


def test_exchanging_the_maps_gives_the_inverse_to_the_last_digit(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, FRAMES[0], 2)
    there, back = register_by_features(a, b, TOLERANT), register_by_features(b, a, TOLERANT)
    assert there.accepted
    np.testing.assert_allclose(se2.compose(pose_of(there), pose_of(back)), np.zeros(3), atol=1e-12)
    assert (there.inliers, there.acceptance) == (back.inliers, back.acceptance)


def test_same_seed_same_answer(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, FRAMES[1], 2)
    assert (
        pose_of(register_by_features(a, b, TOLERANT, 5)).tolist()
        == pose_of(register_by_features(a, b, TOLERANT, 5)).tolist()
    )


def told(found):
    """The pose in numbers; None where no motion fits."""
    return None if found.T_a_b is None else tuple(found.T_a_b.tolist())


def test_runs_with_many_seeds_are_what_each_seed_gives(view):
    a, b = view(12.0, 30.0, FRAMES[1], 2), view(0.0, 20.0, np.zeros(3), 1)
    few = replace(TOLERANT, trials=2, hypotheses=1, features=FeatureMethod("akaze"))  # so few that the seed tells
    seeds = range(8)
    found = register_with_seeds(a, b, few, seeds)
    for seed, each in zip(seeds, found, strict=True):
        alone = register_by_features(a, b, few, seed)
        assert told(each) == told(alone)
        assert (each.accepted, each.reason, each.inliers) == (alone.accepted, alone.reason, alone.inliers)
    assert len({told(each) for each in found}) > 1, "the seeds were not told apart"
    for back, each in zip(register_with_seeds(b, a, few, seeds), found, strict=True):
        if each.T_a_b is not None:
            np.testing.assert_allclose(pose_of(back.inverse()), pose_of(each), atol=1e-9)


def test_runs_with_many_seeds_need_one_alpha(view):
    a = view(0.0, 20.0, np.zeros(3), 1)
    with pytest.raises(FusionError, match="alpha"):
        register_with_seeds(a, a, replace(THESIS, alpha=None), (0, 1))


@pytest.mark.parametrize("settings", [THESIS, TOLERANT])
def test_views_that_share_nothing_are_refused(view, settings):
    a, b = view(0.0, 13.0, np.zeros(3), 1), view(17.0, 30.0, FRAMES[0], 2)
    assert not register_by_features(a, b, settings).accepted


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ([[0.0, 0.0], [0.0, 0.0]], "no cell that is free"),
        ([[2.0, 2.0], [2.0, 2.0]], "no cell that is free"),
        ([[-2.0]], "no motion fits"),
    ],
)
@pytest.mark.parametrize("swap", [False, True])
def test_maps_that_cannot_be_aligned_are_refused_with_the_reason(view, values, reason, swap):
    poor, rich = grid_of(values), view(0.0, 20.0, np.zeros(3), 1)
    found = register_by_features(rich, poor, TOLERANT) if swap else register_by_features(poor, rich, TOLERANT)
    assert not found.accepted
    assert reason in found.reason
    if "free" in reason:
        assert ("second" if swap else "first") in found.reason


def test_one_cell_maps_are_not_taken_for_one_map():
    assert not register_by_features(grid_of([[-2.0]]), grid_of([[-2.0]]), THESIS).accepted


def test_the_thesis_settings_are_the_thesis_values():
    assert (THESIS.alpha, THESIS.max_ratio, THESIS.tolerance_px, THESIS.trials) == (0.99, 0.6, 1.5, 1000)
    assert (THESIS.confidence, THESIS.rule.min_inliers, THESIS.rule.min_acceptance) == (0.99, 10, 0.95)
    assert (THESIS.features.name, THESIS.scale, THESIS.common_cell) == ("kaze+sift", "known", "coarse")


CHOICES = {
    "detector": replace(TOLERANT, features=FeatureMethod("akaze")),
    "alpha auto": replace(THESIS, alpha=None, features=FeatureMethod("akaze")),
    "original map": replace(TOLERANT, alpha=0.0),
    "scale": replace(TOLERANT, alpha=0.7, scale="estimate"),
    "fine": replace(TOLERANT, alpha=0.7, common_cell="fine"),
}


@pytest.mark.parametrize("settings", CHOICES.values(), ids=CHOICES)
def test_every_choice_finds_the_pose_and_its_inverse(view, settings):
    resolution_b = 0.08 if settings.common_cell == "fine" or settings.scale == "estimate" else 0.05
    a, b = view(0.0, 16.0, np.zeros(3), 1), view(4.0, 20.0, FRAMES[0], 2, resolution_b)
    there, back = (register_by_features(*maps, settings) for maps in ((a, b), (b, a)))
    assert there.accepted, there.reason
    error = alignment_error(a, b, pose_of(there), se2.inverse(FRAMES[0]))
    assert (error.rms_m < 0.10, error.rotation_deg < 1.0) == (True, True)
    np.testing.assert_allclose(se2.compose(pose_of(there), pose_of(back)), np.zeros(3), atol=1e-12)
    assert there.reason == back.reason


def test_the_scale_comes_out_as_the_ratio_of_the_resolutions(view):
    a, b = view(0.0, 16.0, np.zeros(3), 1), view(4.0, 20.0, FRAMES[0], 2, 0.08)
    found = register_by_features(a, b, CHOICES["scale"])
    assert found.scale == pytest.approx(0.08 / 0.05, rel=0.005)
    assert register_by_features(b, a, CHOICES["scale"]).scale == pytest.approx(0.05 / 0.08, rel=0.005)
    assert register_by_features(a, b, replace(TOLERANT, common_cell="fine")).scale is None


def test_a_scale_that_the_resolutions_do_not_have_is_refused(view):
    """One of the YAML files says 0.055 m although its cells are 0.05 m."""
    a, b = view(0.0, 16.0, np.zeros(3), 1), view(4.0, 20.0, FRAMES[0], 2)
    wrong = OccupancyGrid(b.log_odds, 0.055, b.origin)
    rule = replace(TOLERANT.rule, min_acceptance=0.5, min_wall_m=0.0, max_conflict=1.0)
    found = register_by_features(a, wrong, replace(CHOICES["scale"], rule=rule))
    assert not found.accepted
    assert "a metric map has no free scale" in found.reason
    assert found.scale == pytest.approx(1.0, abs=0.01)


def test_the_chosen_alpha_has_the_best_acceptance_index(view):
    a, b = view(0.0, 16.0, np.zeros(3), 1), view(4.0, 20.0, FRAMES[0], 2)
    fast = replace(THESIS, features=FeatureMethod("orb"), rule=replace(THESIS.rule, min_inliers=6))
    chosen = register_by_features(a, b, replace(fast, alpha=None))
    each = [register_by_features(a, b, replace(fast, alpha=alpha)) for alpha in ALPHAS]
    enough = [found for found in each if (found.inliers or 0) >= 6]
    assert chosen.acceptance == max(found.acceptance for found in enough)
    named = float(chosen.reason.split("(alpha ")[1].split(",")[0])
    assert each[ALPHAS.index(named)].reason == chosen.reason.split(" (alpha")[0]


def test_a_map_whose_cells_are_all_less_free_than_alpha_is_refused_in_words(view):
    """A clamp of 2 ends at p(free) = 0.88: nothing is left of the layer at the thesis's alpha."""
    rich = view(0.0, 16.0, np.zeros(3), 1)
    clamped = OccupancyGrid(np.clip(rich.log_odds, -2.0, 2.0), 0.05, rich.origin)
    found = register_by_features(rich, clamped, THESIS)
    assert found.reason == (
        "the second map has no cell that is free with p >= 0.99: its freest has 0.881, a lower alpha is needed"
    )
    assert register_by_features(rich, clamped, replace(THESIS, alpha=None)).accepted


def test_the_coarse_map_may_be_brought_to_the_finer_cell(view):
    a, b = view(0.0, 12.0, np.zeros(3), 1), view(0.0, 12.0, FRAMES[0], 2, 0.10)
    coarse, fine = (match_maps(a, b, replace(TOLERANT, common_cell=cell)).keypoints for cell in ("coarse", "fine"))
    assert fine[0] > coarse[0]
    assert fine[0] == match_maps(a, a, TOLERANT).keypoints[0]


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("alpha", 1.0, "alpha 1: must be 0.01 to 0.99"),
        ("alpha", float("nan"), "alpha nan"),
        ("max_ratio", 0.0, "ratio 0: must be above 0"),
        ("tolerance_px", float("nan"), "tolerance nan"),
        ("trials", 0, "trials 0"),
        ("confidence", 1.0, "confidence 1: "),
    ],
)
def test_settings_that_no_stage_can_use_are_refused(name, value, says):
    with pytest.raises(FusionError, match=says):
        replace(THESIS, **{name: value})
