from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.depth_sensor_model import DepthModel
from mapping.sensor_models import log_odds
from mapping.virtual_scan import VirtualScan

CELL_M = 0.05


def beams(ranges_m, sigma_m, free_to_m=None, origin=(0.0, 0.0)):
    ranges = np.atleast_1d(np.array(ranges_m, float))
    free = ranges if free_to_m is None else np.atleast_1d(np.array(free_to_m, float))
    angles = np.linspace(-0.3, 0.3, len(ranges)) if len(ranges) > 1 else np.zeros(1)
    sigma = np.broadcast_to(sigma_m, ranges.shape)
    return VirtualScan(0, np.array(origin), angles, ranges, sigma, np.full(len(ranges), 0.3), free)


def test_free_up_to_two_sigma_before_the_obstacle_and_no_farther_than_the_limit():
    begin, end = DepthModel().free(beams([2.0, 3.5, 5.0, 0.0, 0.0, 0.35], 0.04, [2.0, 3.5, 5.0, 2.4, 0.0, 0.35]))
    np.testing.assert_allclose(end, [1.92, 3.42, 4.0, 2.32, 0.0, 0.0])
    np.testing.assert_allclose(begin, [0.3, 0.3, 0.3, 0.3, 0.0, 0.0])


@pytest.mark.parametrize("sigma", [0.01, 0.03, 0.1])
def test_obstacle_covers_one_sigma_to_either_side_without_gaps(sigma):
    points, evidence = DepthModel().hits(beams(2.0, sigma, origin=(0.3, -0.2)), CELL_M)
    along = points[:, 0] - 0.3
    assert points[:, 1] == pytest.approx(-0.2)
    assert (along.min(), along.max()) == pytest.approx((2.0 - sigma, 2.0 + sigma))
    assert np.diff(along).max() <= CELL_M / 2 + 1e-12
    assert evidence.argmax() == np.abs(along - 2.0).argmin()


def test_evidence_is_full_while_the_noise_fits_a_cell_and_falls_in_proportion():
    strongest = [DepthModel().hits(beams(2.0, sigma), CELL_M)[1].max() for sigma in (0.0, 0.025, 0.05, 0.1)]
    full = log_odds(0.65)
    np.testing.assert_allclose(strongest, [full, full, full / 2, full / 4], rtol=1e-2)


def test_a_noisy_beam_says_about_as_much_in_all_as_a_sharp_one():
    """Over the cells that it covers, so that range blurs a wall but does not make it count more."""
    totals = []
    for sigma in (0.02, 0.1, 0.2):
        points, evidence = DepthModel().hits(beams(2.013, sigma), CELL_M)
        cells = np.floor(points[:, 0] / CELL_M).astype(int)
        totals.append(sum(evidence[cells == cell].max() for cell in np.unique(cells)))
    assert max(totals) < 2.1 * min(totals)


def test_obstacles_beyond_the_mark_range_are_not_drawn():
    points, _ = DepthModel().hits(beams([2.9, 3.1, 0.0], 0.0), CELL_M)
    assert len(points) == 1
    none, evidence = DepthModel().hits(beams([3.1, 0.0], 0.1), CELL_M)
    assert (len(none), len(evidence)) == (0, 0)


def test_a_miss_speaks_for_free_space():
    assert DepthModel(miss_probability=0.4).miss_log_odds == pytest.approx(math.log(0.4 / 0.6))
