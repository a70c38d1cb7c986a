from __future__ import annotations

import itertools
import types

import pytest

from tools.stopwatch import Stopwatch


class Clock:
    """Time that passes only when it is told to."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clocks():
    return Clock(), Clock()


def test_a_stage_within_a_stage_counts_only_for_itself(clocks):
    cpu, wall = clocks
    watch = Stopwatch(clocks)
    with watch.stage("outer"):
        cpu.now_s += 1.0
        wall.now_s += 2.0
        with watch.stage("inner"):
            cpu.now_s += 10.0
            wall.now_s += 20.0
        cpu.now_s += 0.5
    cpu.now_s += 100.0  # in no stage
    outer, inner = watch.stages["outer"], watch.stages["inner"]
    assert (outer.cpu_s, outer.wall_s, outer.calls) == (1.5, 2.0, 1)
    assert (inner.cpu_s, inner.wall_s, inner.calls) == (10.0, 20.0, 1)


def test_a_stage_that_fails_is_counted_and_left(clocks):
    watch = Stopwatch(clocks)

    def fails() -> None:
        clocks[0].now_s += 1.0
        raise KeyError

    with pytest.raises(KeyError), watch.stage("outer"), watch.stage("inner"):
        fails()
    with watch.stage("outer"):
        clocks[0].now_s += 4.0
    assert watch.stages["inner"].cpu_s == 1.0
    assert watch.stages["outer"].cpu_s == 4.0


def test_timed_parts_do_the_same_and_are_put_back(clocks):
    ticks = itertools.count()

    class Part:
        def work(self, by: int, *, more: int) -> int:
            clocks[0].now_s += 1.0
            next(ticks)
            return by + more

    module = types.ModuleType("module")
    module.__dict__["double"] = double = lambda value: 2 * value
    original = Part.work
    watch = Stopwatch(clocks)
    with watch.timing(((Part, "work", "part"), (module, "double", "module"))):
        assert Part().work(1, more=2) == 3
        assert module.double(4) == 8
        assert Part.work is not original
    assert Part.work is original
    assert module.double is double
    assert watch.stages["part"].cpu_s == 1.0
    assert watch.stages["module"].calls == 1
    assert next(ticks) == 1


def test_a_part_that_is_not_there_is_refused_before_anything_is_changed():
    class Part:
        def work(self) -> None: ...

    original = Part.work
    with pytest.raises(AttributeError, match="rest"), Stopwatch().timing(((Part, "work", "a"), (Part, "rest", "b"))):
        pass
    assert Part.work is original
