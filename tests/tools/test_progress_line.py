"""What is told of a long job, on a terminal and elsewhere."""

from __future__ import annotations

import io
import logging

import pytest

from tools.progress_line import ProgressLine, time_in_words


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def informed(caplog):
    caplog.set_level(logging.INFO)


def test_on_a_terminal_one_line_is_rewritten_with_the_time_left():
    now, screen = [0.0], Terminal()
    line = ProgressLine("{done} of {count} pairs", stream=screen, clock=lambda: now[0])
    for done in range(1, 101):
        now[0] += 3.0
        line.tell(done, 100)
    shown = screen.getvalue()
    assert shown.count("\n") == 1
    assert "\r\033[K20 of 100 pairs, 4 min left" in shown
    assert shown.endswith("100 of 100 pairs\n")


def test_a_line_is_not_rewritten_faster_than_it_can_be_read():
    now, screen = [0.0], Terminal()
    line = ProgressLine("{done} of {count}", stream=screen, clock=lambda: now[0])
    for done in range(1, 1001):
        now[0] += 0.001
        line.tell(done, 1000)
    assert screen.getvalue().count("\r") <= 8


def test_elsewhere_a_line_comes_now_and_then_and_at_the_end_of_each_batch():
    now, said = [0.0], list[str]()
    line = ProgressLine("{done} of {count}", stream=io.StringIO(), say=said.append, clock=lambda: now[0])
    for done in range(1, 41):
        now[0] += 1.0
        line.tell(done, 40)
    for done in range(41, 46):
        line.tell(done, 45)
    assert said[0].startswith("1 of 40")
    assert said[1] == "16 of 40, 24 s left"
    assert said[-2:] == ["40 of 40", "45 of 45"]
    assert len(said) == 5


def test_what_an_earlier_run_had_done_does_not_make_this_one_look_fast():
    now, said = [0.0], list[str]()
    line = ProgressLine("{done} of {count}", stream=io.StringIO(), say=said.append, clock=lambda: now[0])
    now[0] = 10.0
    line.tell(91, 100)
    assert said == ["91 of 100, 90 s left".replace("90 s", "2 min")]


@pytest.mark.parametrize(("seconds", "words"), [(5.4, "5 s"), (600.0, "10 min"), (7200.0, "2.0 h")])
def test_times_as_people_say_them(seconds, words):
    assert time_in_words(seconds) == words


def test_what_ends_the_job_half_way_finds_a_line_of_its_own():
    screen = Terminal()

    def interrupted():
        with ProgressLine("{done} of {count}", stream=screen, clock=lambda: 0.0) as line:
            line.tell(3, 9)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert screen.getvalue().endswith("3 of 9\n")
    with ProgressLine("{done} of {count}", stream=screen) as line:
        line.tell(9, 9)
    assert screen.getvalue().endswith("9 of 9\n")
    assert not screen.getvalue().endswith("\n\n")
