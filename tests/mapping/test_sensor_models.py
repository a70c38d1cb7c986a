from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.sensor_models import LidarModel, log_odds


@given(st.floats(1e-6, 1.0 - 1e-6))
def test_log_odds_are_undone_by_the_logistic_function_and_odd(probability: float) -> None:
    value = log_odds(probability)
    assert 1.0 / (1.0 + math.exp(-value)) == pytest.approx(probability, rel=1e-9)
    assert log_odds(1.0 - probability) == pytest.approx(-value, abs=1e-9)  # 1 - 1e-6 has ten digits left of 1e-6


def test_even_odds_say_nothing() -> None:
    assert log_odds(0.5) == 0.0


@pytest.mark.parametrize("probability", [0.0, 1.0, -0.1, 1.1, math.nan])
def test_certainty_and_nonsense_have_no_log_odds(probability: float) -> None:
    with pytest.raises(ValueError, match=r"inside \(0, 1\)"):
        log_odds(probability)


def test_hits_count_in_full_up_to_the_range_whose_noise_fills_a_cell() -> None:
    # 1 % of 2.5 m is 2.5 cm to either side: a cell of 5 cm. At 5 m the same evidence covers two cells, at 10 m four.
    evidence = LidarModel(hit_probability=0.7, noise_fraction=0.01).hit_log_odds(np.array([0.5, 2.5, 5.0, 10.0]), 0.05)
    full = log_odds(0.7)
    np.testing.assert_allclose(evidence, [full, full, full / 2.0, full / 4.0], rtol=1e-12)


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=10).map(sorted), st.floats(0.01, 0.5))
def test_farther_hits_never_say_more(ranges: list[float], resolution_m: float) -> None:
    evidence = LidarModel().hit_log_odds(np.array(ranges), resolution_m)
    assert (np.diff(evidence) <= 0.0).all()
    assert (evidence > 0.0).all()


def test_a_miss_speaks_for_free_space() -> None:
    assert LidarModel(miss_probability=0.4).miss_log_odds == pytest.approx(math.log(0.4 / 0.6))
    assert LidarModel().miss_log_odds < 0.0 < LidarModel().hit_log_odds(np.array([1.0]), 0.05)[0]
