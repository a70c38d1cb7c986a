from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapping import se2
from mapping.metrics import DeltaUnit, absolute_trajectory_error, align_points, relative_pose_error
from mapping.trajectory import Trajectory

FloatArray = NDArray[np.float64]

OFFSETS = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-3.1, 3.1)).map(np.array)


def curve(count: int = 40) -> Trajectory:
    """Return a bent drive of which no turned copy fits."""
    time = np.linspace(0.0, 4.0, count)
    poses = np.column_stack([time, 0.3 * time**2, np.arctan(0.6 * time)])
    return Trajectory((time * 1e9).astype(np.int64), poses)


def moved(trajectory: Trajectory, offset: FloatArray) -> Trajectory:
    return Trajectory(trajectory.stamps_ns, se2.compose(offset, trajectory.poses))


@given(OFFSETS)
def test_estimate_in_another_frame_has_no_error_and_its_offset_is_found(T_truth_estimate: FloatArray) -> None:
    truth = curve()
    error = absolute_trajectory_error(moved(truth, se2.inverse(T_truth_estimate)), truth)
    assert error.poses == 40
    # Coordinates up to 50 m with 16 digits, summed 40 times.
    assert error.max_m < 1e-11
    assert error.max_deg < 1e-9
    difference = np.array(error.T_truth_estimate) - T_truth_estimate
    np.testing.assert_allclose([*difference[:2], se2.wrap_angle(difference[2])], 0.0, atol=1e-10)


@given(OFFSETS, st.integers(2, 20))
def test_point_alignment_recovers_a_known_transform(T_target_source: FloatArray, count: int) -> None:
    source = np.random.default_rng(count).uniform(-5.0, 5.0, (count, 2))
    found = align_points(se2.transform_points(T_target_source, source), source)
    # Two points may lie 1e-2 m apart, which makes the angle a thousand times less exact than the coordinates.
    np.testing.assert_allclose(
        se2.transform_points(found, source), se2.transform_points(T_target_source, source), atol=1e-9
    )


def test_no_rigid_motion_fits_better_than_the_alignment() -> None:
    generator = np.random.default_rng(3)
    source = generator.uniform(-2.0, 2.0, (30, 2))
    target = se2.transform_points([1.0, 2.0, 0.7], source) + generator.normal(0.0, 0.1, (30, 2))
    best = align_points(target, source)

    def cost(pose: FloatArray) -> float:
        return float(((se2.transform_points(pose, source) - target) ** 2).sum())

    for step in (*np.eye(3), *-np.eye(3)):
        assert cost(best) < cost(best + 1e-3 * step)


def test_known_errors_are_measured() -> None:
    truth = Trajectory(np.arange(4), np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]))
    estimate = Trajectory(np.arange(4), np.array([[0.0, 0, 0], [1, 0.3, 0], [2, -0.4, 0], [3, 0, np.pi / 6]]))
    error = absolute_trajectory_error(estimate, truth, align=False)
    assert error.rms_m == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 4))
    assert error.mean_m == pytest.approx(0.7 / 4)
    assert error.max_m == pytest.approx(0.4)
    assert error.median_m == pytest.approx(0.15)
    assert error.mean_deg == pytest.approx(30.0 / 4)
    assert error.median_deg == 0.0
    assert error.rms_deg == pytest.approx(15.0)
    assert error.max_deg == pytest.approx(30.0)


def test_heading_error_is_measured_the_short_way_round() -> None:
    truth = Trajectory(np.arange(2), np.array([[0.0, 0, 3.1], [1.0, 0, 3.1]]))
    estimate = Trajectory(np.arange(2), np.array([[0.0, 0, 3.1], [1.0, 0, -3.1]]))
    error = absolute_trajectory_error(estimate, truth, align=False)
    assert error.max_deg == pytest.approx(np.degrees(2 * np.pi - 6.2))


def test_without_alignment_the_first_poses_meet() -> None:
    truth = curve()
    offset = np.array([3.0, -1.0, 2.0])
    error = absolute_trajectory_error(moved(truth, offset), truth, align=False)
    assert error.max_m < 1e-12
    np.testing.assert_allclose(error.T_truth_estimate, se2.inverse(offset), atol=1e-12)


def test_only_poses_that_truth_covers_count() -> None:
    estimate = curve(40)
    truth = Trajectory(estimate.stamps_ns[10:21], estimate.poses[10:21])
    error = absolute_trajectory_error(estimate, truth)
    assert (error.poses, error.uncovered, error.truth_covered) == (11, 29, 1.0)


def test_estimate_that_ends_early_covers_a_part_of_the_truth() -> None:
    truth = curve(40)
    error = absolute_trajectory_error(Trajectory(truth.stamps_ns[:10], truth.poses[:10]), truth)
    assert (error.poses, error.uncovered, error.truth_covered) == (10, 0, 0.25)


def test_truth_is_interpolated_at_the_stamps_of_the_estimate() -> None:
    truth = Trajectory(np.array([0, 1000]), np.array([[0.0, 0, 0], [10.0, 0, 0]]))
    estimate = Trajectory(np.array([0, 250, 400]), np.array([[0.0, 0, 0], [2.5, 0, 0], [4.0, 0, 0]]))
    assert absolute_trajectory_error(estimate, truth, align=False).max_m < 1e-12


def test_one_common_pose_gives_its_frame() -> None:
    single = Trajectory(np.array([5]), np.array([[1.0, 2.0, 0.5]]))
    truth = Trajectory(np.array([0, 10]), np.array([[0.0, 0, 0], [2.0, 0, 0]]))
    error = absolute_trajectory_error(single, truth)
    assert (error.poses, error.max_m, error.max_deg) == (1, pytest.approx(0.0, abs=1e-12), pytest.approx(0.0, abs=1e-9))


@pytest.mark.parametrize("stamps", [[], [100, 200]])
def test_trajectories_without_common_time_are_refused(stamps: list[int]) -> None:
    other = Trajectory(np.array(stamps, dtype=np.int64), np.zeros((len(stamps), 3)))
    here = Trajectory(np.array([0, 10]), np.zeros((2, 3)))
    for estimate, truth in ((other, here), (here, other)):
        with pytest.raises(ValueError, match="no time in common"):
            absolute_trajectory_error(estimate, truth)
        with pytest.raises(ValueError, match="no time in common"):
            relative_pose_error(estimate, truth, 1.0, "s")


def straight(step_m: float, count: int = 21) -> Trajectory:
    """Return a drive along x at ten poses a second."""
    places = np.arange(count) * step_m
    return Trajectory(np.arange(count) * 10**8, np.column_stack([places, np.zeros((count, 2))]))


@given(OFFSETS, st.sampled_from(["s", "m"]), st.floats(0.1, 2.0))
def test_relative_error_does_not_depend_on_the_frames(offset: FloatArray, unit: DeltaUnit, delta: float) -> None:
    truth = curve(200)
    error = relative_pose_error(moved(truth, offset), truth, delta, unit)
    assert error.pairs > 50
    assert error.max_m < 1e-10
    assert error.max_deg < 1e-6


@pytest.mark.parametrize(("unit", "delta", "pairs"), [("s", 1.0, 11), ("m", 1.0, 11), ("m", 0.5, 16), ("s", 0.1, 20)])
def test_scale_error_is_that_of_the_interval(unit: DeltaUnit, delta: float, pairs: int) -> None:
    error = relative_pose_error(straight(0.11), straight(0.10), delta, unit)
    assert error.pairs == pairs
    assert error.interval == pytest.approx(delta)
    for value in (error.rms_m, error.mean_m, error.median_m, error.max_m):
        assert value == pytest.approx(0.1 * delta)
    assert error.max_deg == 0.0


def test_one_wrong_turn_costs_the_pairs_across_it_only() -> None:
    truth = straight(0.1)
    corner = np.where(np.arange(21) > 10, np.radians(10.0), 0.0)
    bent = Trajectory(truth.stamps_ns, np.column_stack([truth.poses[:, :2], corner]))
    error = relative_pose_error(bent, truth, 0.5, "s")
    assert error.max_deg == pytest.approx(10.0)
    assert error.mean_deg == pytest.approx(10.0 * 5 / 16)
    assert error.median_deg == 0.0


def test_poses_that_are_sparser_than_the_interval_pair_with_the_nearest() -> None:
    truth = straight(0.7)
    error = relative_pose_error(truth, truth, 1.0, "m")
    assert error.interval == pytest.approx(0.7)
    with pytest.raises(ValueError, match="no two poses"):
        relative_pose_error(truth, truth, 0.3, "m")


@pytest.mark.parametrize("delta", [0.0, -1.0, float("nan"), float("inf"), 99.0])
def test_interval_that_no_pair_has_is_refused(delta: float) -> None:
    with pytest.raises(ValueError, match="interval"):
        relative_pose_error(straight(0.1), straight(0.1), delta, "s")
