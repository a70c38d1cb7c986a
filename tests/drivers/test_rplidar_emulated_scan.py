from __future__ import annotations

import numpy as np
import pytest

from drivers.rplidar_capsules import decode_express, decode_nodes, decode_ultra
from drivers.rplidar_emulated_scan import EmulatedScan, Motor
from drivers.rplidar_models import A2M8
from drivers.rplidar_protocol import Answer

S = 1_000_000_000
DECODE = {Answer.NODES: decode_nodes, Answer.EXPRESS: decode_express, Answer.ULTRA: decode_ultra}


class Recorder:
    """A world whose distance depends on the angle; remembers at which angles and times it was asked."""

    def __init__(self) -> None:
        self.theta_rad = np.zeros(0)
        self.times_ns = np.zeros(0, dtype=np.int64)

    def __call__(self, times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
        self.theta_rad = np.concatenate((self.theta_rad, theta_rad))
        self.times_ns = np.concatenate((self.times_ns, times_ns))
        return 2.0 + np.sin(theta_rad)


class Constant:
    """A world at one distance all around."""

    def __init__(self, distance_m: float) -> None:
        self.distance_m = distance_m

    def __call__(self, times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
        return np.full(theta_rad.shape, self.distance_m)


def test_motor_angle_is_continuous_over_speed_changes() -> None:
    motor = Motor(660, 10.0)
    motor.set_pwm(330, 2 * S)
    times = np.array([1.9, 2.0, 2.1])
    assert motor.turns(times).tolist() == pytest.approx([19.0, 20.0, 20.5])
    motor.set_pwm(0, 3 * S)
    assert not motor.running
    assert motor.turns(np.array([3.0, 9.0])).tolist() == pytest.approx([25.0, 25.0])


def test_a_drifting_motor_swings_around_its_speed() -> None:
    motor, share, period_s = Motor(660, 10.0, (0.1, 8.0)), 0.1, 8.0
    motor.set_pwm(330, 16 * S)
    times = np.arange(0.0, 32.0, 0.001)
    rate = np.diff(motor.turns(times)) / 0.001
    expected = np.where(times < 16.0, 10.0, 5.0) * (1.0 + share * np.sin(2 * np.pi * times / period_s))
    assert np.abs(rate - expected[:-1]).max() < 0.02
    assert motor.turns(np.array([16.0, 32.0])).tolist() == pytest.approx([160.0, 240.0])


@pytest.mark.parametrize("kind", list(DECODE))
def test_decoded_samples_are_where_the_rays_went(kind: Answer) -> None:
    world = Recorder()
    scan = EmulatedScan(A2M8.mode_answering(kind), 115200, Motor(660, 10.0), world, S)
    packets = scan.due(S + S // 2)
    samples = DECODE[kind](packets)
    theta = samples.angle_q6 / 64 * np.pi / 180
    error_m = samples.distance_q2 / 4000 - (2.0 + np.sin(theta))
    seen = samples.distance_q2 > 0
    assert seen.all()
    assert np.abs(error_m).max() < 0.006
    assert world.times_ns.min() >= S - 500_000
    assert world.times_ns.max() <= S + S // 2
    if kind != Answer.NODES:
        assert np.flatnonzero(packets[:, 3] & 0x80).tolist() == [0]


def test_nothing_beyond_the_range_and_nothing_too_near() -> None:
    for distance_m in (0.0, 0.1, 12.5, np.inf, np.nan):
        world = Constant(distance_m)
        scan = EmulatedScan(A2M8.mode_answering(Answer.ULTRA), 115200, Motor(660, 10.0), world, S)
        assert not decode_ultra(scan.due(2 * S)).distance_q2.any()
