from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import LidarStream
from drivers.rplidar_capsules import Samples
from drivers.rplidar_sample_clock import SampleClock
from drivers.rplidar_turns import TurnAssembler

STREAM = LidarStream(0, "A2M8", "1.28", 7, "", 115200, "Express", 0x82, 250.0, 12.0)


def assembler() -> TurnAssembler:
    clock = SampleClock(250e-6)
    clock.observe(0, 0.0)
    return TurnAssembler(STREAM, clock, 1000)


def samples(degrees: list[float]) -> Samples:
    angle = np.array([round(degree * 64) for degree in degrees])
    return Samples(angle, np.full(len(angle), 4000), np.array([degree == 0 for degree in degrees]))


def test_a_turn_ends_where_the_next_begins() -> None:
    turns = assembler()
    assert turns.add(samples([90, 180, 270]), 0) == []
    first, second = turns.add(samples([0, 90, 180, 0]), 3)
    assert np.rad2deg(first.angles_rad).tolist() == pytest.approx([-90, 180, 90])
    assert (first.complete, second.complete) == (False, True)
    assert first.ranges_m.tolist() == [1.0] * 3
    assert (first.stamp_ns, second.stamp_ns) == (1000, 1000 + 750_000)
    assert second.intensities is None


def test_a_gap_inside_a_turn_leaves_one_partial_scan() -> None:
    turns = assembler()
    turns.add(samples([0, 30]), 0)
    turns.gap()
    assert turns.add(samples([90]), 50) == []
    (scan,) = turns.add(samples([0]), 51)
    assert not scan.complete
    assert len(scan.ranges_m) == 3


def test_a_turn_s_end_that_is_a_guess_leaves_no_turn_whole() -> None:
    turns = assembler()
    turns.add(samples([0, 300]), 0)
    (scan,) = turns.end_turn(guessed=True)
    assert (scan.complete, len(scan.ranges_m)) == (False, 2)
    (rest, whole) = turns.add(samples([40, 0, 180, 0]), 50)
    assert (rest.complete, len(rest.ranges_m)) == (False, 1)
    assert whole.complete


def test_a_gap_longer_than_a_turn_splits_it() -> None:
    turns = assembler()
    turns.add(samples([0, 30]), 0)
    turns.gap()
    assert len(turns.add(samples([90]), 2000)) == 1


def test_discarded_samples_are_not_emitted() -> None:
    turns = assembler()
    turns.add(samples([0, 30]), 0)
    turns.discard()
    (scan,) = turns.add(samples([40, 0]), 2)
    assert (scan.complete, len(scan.ranges_m)) == (False, 1)


def test_times_rise_although_the_clock_is_set_back() -> None:
    clock = SampleClock(250e-6)
    clock.observe(0, 0.1)
    turns = TurnAssembler(STREAM, clock, 0)
    (first,) = turns.add(samples([10, 20, 0]), 0)
    clock.observe(2, 0.05)
    (second,) = turns.add(samples([10, 20, 0]), 3)
    assert second.stamp_ns > first.stamp_ns + first.offsets_s[-1] * 1e9
    assert (np.diff(second.offsets_s) > 0).all()
