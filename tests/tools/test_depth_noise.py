from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tools.depth_noise import NO_NOISE, DepthNoise, noisy_depth

FOCAL_PX = 425.0
BASE = FOCAL_PX * 0.05  # disparity in px at 1 m
SMOOTH = DepthNoise(hole_share=0.0)


def measured(true_m, noise, seed=0):
    true = np.broadcast_to(np.asarray(true_m, np.float32), (240, 320)) if np.ndim(true_m) < 2 else true_m
    return noisy_depth(true, FOCAL_PX, noise, np.random.default_rng(seed), 0.001) * 0.001


def errors(z, noise):
    """Errors of depth on a wall at z, right of the left margin, over several frames."""
    return np.stack([measured(z, noise, seed)[:, 80:] - z for seed in range(8)])


def test_without_noise_only_steps_of_disparity_remain():
    for z in (0.5, 1.0, 2.0, 4.0):
        step_m = z * z / BASE / 32.0
        assert np.abs(measured(z, NO_NOISE)[:, 80:] - z).max() <= step_m / 2 + 0.0006
    distances = np.linspace(3.0, 3.05, 320, dtype=np.float32)
    found = np.unique(measured(np.tile(distances, (240, 1)), NO_NOISE)[:, 80:])
    assert len(found) <= 7  # a step is 13 mm at 3 m


def test_error_grows_with_the_square_of_the_range():
    spread = [errors(z, SMOOTH).std() for z in (1.0, 2.0, 4.0)]
    assert spread[1] / spread[0] == pytest.approx(4.0, rel=0.2)
    assert spread[2] / spread[1] == pytest.approx(4.0, rel=0.2)
    assert 0.015 < spread[1] < 0.04  # the datasheet's 2 % of 2 m are 0.04


def test_neighbours_err_alike_and_distant_pixels_do_not():
    error = errors(2.0, SMOOTH)

    def correlation(apart):
        return np.corrcoef(error[:, :, :-apart].ravel(), error[:, :, apart:].ravel())[0, 1]

    assert correlation(2) > 0.7
    assert abs(correlation(40)) < 0.1


def test_left_margin_is_as_wide_as_the_disparity():
    for z in (0.5, 1.0, 2.0):
        assert np.count_nonzero(measured(z, NO_NOISE)[10] == 0.0) == pytest.approx(BASE / z, abs=1.0)


def test_beside_an_edge_what_only_one_imager_sees_is_missing():
    true = np.full((240, 320), 3.0, np.float32)
    true[:, 150:200] = 1.0
    depth = measured(true, NO_NOISE)
    hidden = np.flatnonzero(depth[50, 80:] == 0.0) + 80
    assert hidden.max() == 149  # left of the near thing only
    assert len(hidden) == pytest.approx(BASE / 1.0 - BASE / 3.0, abs=1.5)


def test_edges_are_smeared_into_depths_that_are_not_there():
    true = np.full((240, 320), 3.0, np.float32)
    true[:, 150:200] = 1.0
    flying = measured(true, replace(NO_NOISE, window_px=7))[:, 200:210]
    assert ((flying > 1.1) & (flying < 2.8)).any()
    assert np.abs(measured(true, NO_NOISE)[:, 200:210] - 3.0).max() < 0.02


def test_holes_take_their_share_in_patches():
    lost = measured(2.0, replace(DepthNoise(), hole_share=0.1))[:, 80:] == 0.0
    assert lost.mean() == pytest.approx(0.1, abs=0.03)
    assert lost[:, 1:][lost[:, :-1]].mean() > 0.7  # the neighbour of a lost pixel is mostly lost


def test_bias_stretches_all_depths():
    plain, biased = errors(2.0, SMOOTH), errors(2.0, replace(SMOOTH, range_bias=0.02))
    assert np.mean(biased - plain) == pytest.approx(0.04, abs=0.002)


def test_what_is_too_near_or_not_there_is_not_measured():
    assert not measured(0.1, NO_NOISE).any()
    assert not measured(0.0, DepthNoise()).any()
