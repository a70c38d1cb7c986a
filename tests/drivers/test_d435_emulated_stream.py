from __future__ import annotations

import mmap
from itertools import count

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.d435_emulated_stream import EmulatedStream, FrameSupply, StreamFaults
from drivers.v4l2 import BUFFER_ERROR, TIMESTAMP_MONOTONIC

PERIOD_NS = 10_000_000
NO_FAULTS = StreamFaults()


def images():
    return (np.full((2, 3), number, np.uint16) for number in count())


def stream(supply=None, *, faults=NO_FAULTS, period_ns=PERIOD_NS, buffers=3) -> EmulatedStream:
    memory = [mmap.mmap(-1, 12) for _ in range(buffers)]
    made = EmulatedStream(
        FrameSupply(images() if supply is None else supply), (3, 2), memory,
        start_ns=100, period_ns=period_ns, faults=faults,
    )  # fmt: skip
    for index in range(buffers):
        made.give(index)
    return made


def test_a_frame_comes_when_it_is_due_and_not_before():
    one = stream()
    one.advance(100 + PERIOD_NS - 1)
    assert not one.ready
    assert one.next_ns() == 100 + PERIOD_NS
    one.advance(100 + PERIOD_NS)
    assert one.ready
    frame = one.take()
    assert (frame.index, frame.bytes_used, frame.flags, frame.sequence) == (0, 12, TIMESTAMP_MONOTONIC, 0)
    assert frame.stamp_ns == 100 + PERIOD_NS


@given(st.lists(st.integers(0, 4 * PERIOD_NS), max_size=30))
def test_however_time_passes_every_frame_is_delivered_or_an_overrun(steps):
    one = stream()
    now_ns, taken = 100, []
    for step in steps:
        now_ns += step
        one.advance(now_ns)
        while (frame := one.take()) is not None:
            taken.append(frame)
            one.give(frame.index)
    assert len(taken) + one.overruns == sum(steps) // PERIOD_NS
    assert [frame.stamp_ns for frame in taken] == [100 + (frame.sequence + 1) * PERIOD_NS for frame in taken]


def test_frames_without_a_buffer_pass_and_are_numbered():
    one = stream(buffers=2)
    one.advance(100 + 5 * PERIOD_NS)
    assert [one.take().sequence, one.take().sequence, one.take()] == [0, 1, None]
    assert one.overruns == 3
    one.give(0)
    one.advance(100 + 6 * PERIOD_NS)
    assert one.take().sequence == 5


def test_a_function_is_asked_only_for_frames_that_are_kept_and_for_their_time():
    asked = []

    def render(stamp_ns):
        asked.append(stamp_ns)
        return np.zeros((2, 3), np.uint16)

    one = stream(render, buffers=2)
    one.advance(100 + 5 * PERIOD_NS)
    assert asked == [100 + PERIOD_NS, 100 + 2 * PERIOD_NS]


def test_running_free_there_is_always_a_frame_as_long_as_there_is_a_buffer():
    one = stream(period_ns=0, buffers=1)
    for now_ns in (100, 100, 107):
        one.advance(now_ns)
        frame = one.take()
        assert frame.stamp_ns == now_ns
        one.give(frame.index)
    one.advance(107)
    one.take()
    one.advance(108)
    assert not one.ready
    assert one.overruns == 0


def test_scripted_faults_hit_their_frames():
    faults = StreamFaults(flagged=frozenset({0}), short=frozenset({1}), gaps={2: 4}, unplug_at=3)
    one = stream(faults=faults)
    one.advance(100 + 9 * PERIOD_NS)
    flagged, short, late = one.take(), one.take(), one.take()
    assert flagged.flags & BUFFER_ERROR
    assert not short.flags & BUFFER_ERROR
    assert (short.bytes_used, late.bytes_used) == (6, 12)
    assert [each.sequence for each in (flagged, short, late)] == [0, 1, 6]
    assert one.unplugged
    assert one.next_ns() is None


@pytest.mark.parametrize("ending", [StreamFaults(silent_from=2), None])
def test_silence_and_the_end_of_the_images_stop_the_frames(ending):
    one = stream(faults=ending) if ending else stream([np.zeros((2, 3), np.uint16)] * 2)
    one.advance(100 + 9 * PERIOD_NS)
    assert [one.take() is None for _ in range(3)] == [False, False, True]
    assert one.next_ns() is None
    assert not one.unplugged


@pytest.mark.parametrize("image", [np.zeros((3, 2), np.uint16), np.zeros((2, 3), np.float32)])
def test_an_image_of_another_mode_is_a_mistake_of_the_caller(image):
    with pytest.raises(ValueError, match=r"expected \(2, 3\) uint16"):
        stream([image]).advance(100 + PERIOD_NS)
