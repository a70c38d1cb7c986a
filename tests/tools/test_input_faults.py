from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.trajectory import Trajectory
from tools import input_faults
from tools.errors import ToolError
from tools.input_faults import FAULTS, FaultyLog

STEP_NS = 500_000_000
COUNT = 800  # 400 s
STAMPS = STEP_NS * np.arange(COUNT, dtype=np.int64)
POSES = se2.exp(np.array([0.5, 0.0, 0.05]) * (STAMPS[:, np.newaxis] * 1e-9))
DRIVEN = Trajectory(STAMPS, POSES)
BEARINGS = np.linspace(-np.pi, np.pi, 180, endpoint=False)


def log() -> list[LaserScan | Odometry]:
    """A scan and, right before it, the odometry, every 0.5 s on a circle."""
    messages: list[LaserScan | Odometry] = []
    for stamp, pose in zip(STAMPS.tolist(), POSES, strict=True):
        messages.append(Odometry(stamp - 1_000_000, pose, np.zeros(3)))
        messages.append(LaserScan(stamp, BEARINGS, np.full(180, 3.0), np.zeros(180), 0.1, 10.0))
    return messages


def faulty(name: str, seed: int = 0) -> FaultyLog:
    return FAULTS[name](log(), DRIVEN, np.random.default_rng(seed))


def scans_of(messages: Sequence[LaserScan | Odometry]) -> list[LaserScan]:
    return [message for message in messages if isinstance(message, LaserScan)]


def wheels_of(messages: Sequence[LaserScan | Odometry]) -> list[Odometry]:
    return [message for message in messages if isinstance(message, Odometry)]


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_repeatable_and_keeps_the_log_in_order(name: str) -> None:
    one, again = faulty(name), faulty(name)
    assert [message.stamp_ns for message in one.messages] == [message.stamp_ns for message in again.messages]
    for first, second in zip(scans_of(one.messages), scans_of(again.messages), strict=True):
        np.testing.assert_array_equal(first.ranges_m, second.ranges_m)
    backwards = np.diff([message.stamp_ns for message in one.messages]) < 0
    assert backwards.sum() == (name == "clock jumps by -5 s")
    assert one.messages != log()


def test_missing_scans_are_ten_seconds_of_them_and_no_odometry() -> None:
    result = faulty("scans missing for 2 s, 5 times")
    assert COUNT - len(scans_of(result.messages)) == pytest.approx(5 * 4, abs=5)
    assert len(wheels_of(result.messages)) == COUNT
    assert len(result.windows) == 5
    assert all(
        not first <= scan.stamp_ns <= last for scan in scans_of(result.messages) for first, last in result.windows
    )


@pytest.mark.parametrize(
    ("name", "share_in", "share_out"),
    [
        ("laser blind for 10 s", 0.0, 1.0),
        ("glass: 60 % invalid for 60 s", 0.4, 0.7),
        ("glass: 30 % invalid", None, 0.7),
    ],
)
def test_so_many_measurements_are_left(name: str, share_in: float | None, share_out: float) -> None:
    result = faulty(name)
    (first, last) = result.windows[0] if result.windows else (-1, -1)
    inside = [scan.valid.mean() for scan in scans_of(result.messages) if first <= scan.stamp_ns <= last]
    outside = [scan.valid.mean() for scan in scans_of(result.messages) if not first <= scan.stamp_ns <= last]
    assert len(inside) + len(outside) == COUNT
    assert np.mean(outside) == pytest.approx(share_out, abs=0.01)
    if share_in is not None:
        assert np.mean(inside) == pytest.approx(share_in, abs=0.03)


def test_glass_takes_whole_sectors() -> None:
    valid = scans_of(faulty("glass: 30 % invalid").messages)[0].valid
    assert np.count_nonzero(np.diff(valid.astype(int))) < 2 * 180 / 9  # single samples would change 75 times


@pytest.mark.parametrize("name", ["kidnapped, 60 s pass", "kidnapped, no time passes"])
def test_the_wheels_of_a_kidnapped_robot_stand_still(name: str) -> None:
    result = faulty(name)
    first, last = result.windows[0]
    assert last - first == 60_000_000_000
    assert COUNT - len(scans_of(result.messages)) == pytest.approx(120, abs=1)
    wheels = wheels_of(result.messages)
    steps = se2.between(
        np.array([message.pose for message in wheels[:-1]]), np.array([message.pose for message in wheels[1:]])
    )
    still = np.hypot(steps[:, 0], steps[:, 1]) < 1e-9
    assert np.count_nonzero(still) == 1  # the step over the cut; all others are as they were
    np.testing.assert_allclose(steps[~still], np.tile(steps[0], (len(steps) - 1, 1)), atol=1e-9)


def test_without_time_for_it_the_cut_leaves_no_gap_in_the_stamps() -> None:
    stamps = [scan.stamp_ns for scan in scans_of(faulty("kidnapped, no time passes").messages)]
    assert set(np.diff(stamps).tolist()) == {STEP_NS}


@pytest.mark.parametrize(
    ("name", "jump_ns"), [("clock jumps by +1 h", 3_600_000_000_000), ("clock jumps by -5 s", -5_000_000_000)]
)
def test_the_clock_jumps_once(name: str, jump_ns: int) -> None:
    scans = scans_of(faulty(name).messages)
    steps = np.diff([scan.stamp_ns for scan in scans])
    assert sorted(set(steps.tolist())) == sorted([STEP_NS, STEP_NS + jump_ns])
    assert len(scans) == COUNT


@pytest.mark.parametrize("name", ["kidnapped, no time passes", "clock jumps by +1 h", "no odometry"])
def test_a_trajectory_of_the_faulty_log_is_brought_back_to_true_time(name: str) -> None:
    result = faulty(name)
    mapped = Trajectory(
        np.array([scan.stamp_ns for scan in scans_of(result.messages)]), np.zeros((len(scans_of(result.messages)), 3))
    )
    in_log = result.in_true_time(mapped).stamps_ns
    assert np.isin(in_log, STAMPS).all()
    assert len(in_log) == len(mapped)
    assert in_log[-1] == STAMPS[-1]


def test_a_log_that_is_too_short_or_stands_still_is_refused() -> None:
    short = Trajectory(STAMPS[:20], POSES[:20])
    with pytest.raises(ToolError, match="take a longer one"):
        input_faults.blinded(log()[:40], short, np.random.default_rng(0))
