from __future__ import annotations

import numpy as np
import pytest

from drivers.emulated_faults import FaultScript, parse_fault, parse_script
from drivers.emulated_optics import faulty_ranger, normal, uniform

TIMES = np.arange(20_000, dtype=np.int64) * 125_000


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 4.0)


def ramp(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.asarray(2.0 + theta_rad)


def measure(script: str, ranger=wall, seed: int = 0, times: np.ndarray = TIMES) -> np.ndarray:
    faults = FaultScript(parse_script(script), seed)
    faults.begin(0)
    return np.asarray(faulty_ranger(ranger, faults)(times, np.ones(len(times))))


def test_without_optical_faults_the_ranger_measures_as_it_is() -> None:
    assert np.array_equal(measure("flip=0.1", ramp), ramp(TIMES, np.ones(len(TIMES))))


def test_a_fault_may_come_later() -> None:
    faults = FaultScript()
    measured = faulty_ranger(wall, faults)
    assert (measured(TIMES, np.ones(len(TIMES))) == 4.0).all()
    faults.add(parse_fault("invalid=1"))
    assert (measured(TIMES, np.ones(len(TIMES))) == 0.0).all()


def test_random_numbers_are_spread_as_they_should() -> None:
    assert np.histogram(uniform(TIMES, 3), bins=10, range=(0, 1))[0] == pytest.approx(2000, abs=200)
    assert (normal(TIMES, 3).mean(), normal(TIMES, 3).std()) == pytest.approx((0.0, 1.0), abs=0.03)
    assert np.abs(np.corrcoef(normal(TIMES, 3), normal(TIMES, 4))[0, 1]) < 0.03


def test_noise_has_an_offset_and_a_share() -> None:
    assert (measure("noise=0.01") - 4.0).std() == pytest.approx(0.01, rel=0.05)
    assert (measure("noise=0.01:0.02") - 4.0).std() == pytest.approx(0.09, rel=0.05)


def test_so_many_samples_measure_nothing() -> None:
    assert np.mean(measure("invalid=0.3") == 0.0) == pytest.approx(0.3, abs=0.02)


def test_rays_go_beside_their_angle() -> None:
    assert np.degrees(measure("jitter=0.5", ramp) - 3.0).std() == pytest.approx(0.5, rel=0.05)


def test_only_while_it_holds() -> None:
    lost = measure("invalid=1@1+0.5") == 0.0
    assert np.array_equal(lost, (TIMES >= 10**9) & (TIMES < 1_500_000_000))


def test_the_same_ray_gives_the_same_answer_and_another_seed_another() -> None:
    whole = measure("noise=0.01\ninvalid=0.1")
    assert np.array_equal(whole[5000:], measure("noise=0.01\ninvalid=0.1", times=TIMES[5000:]))
    assert not np.array_equal(whole, measure("noise=0.01\ninvalid=0.1", seed=1))
