"""What goes along with a session is begun in order, and ended whatever happens."""

from __future__ import annotations

import threading

import pytest

from mapping.mount import Mount
from tools.clock import RunClock
from tools.session_parts import LiveSession, going_along


class Part:
    tells = False
    hurries = False
    needs_map = False

    def __init__(self, name, told, failing=False):
        self.name, self.told, self.failing = name, told, failing

    def begin(self, session):
        self.told.append(f"begin {self.name}")
        if self.failing:
            raise ZeroDivisionError

    def note(self, message):
        raise AssertionError

    def add(self, mapped):
        raise AssertionError

    def end(self):
        self.told.append(f"end {self.name}")

    def save(self, folder):
        return {}


def session():
    return LiveSession(RunClock(), Mount(), lambda _: None, threading.Event())


def test_the_last_to_begin_ends_first():
    told: list[str] = []
    with going_along([Part("a", told), Part("b", told)], session()):
        told.append("run")
    assert told == ["begin a", "begin b", "run", "end b", "end a"]


def test_all_that_began_ends_where_the_run_fails():
    told: list[str] = []
    with pytest.raises(KeyError), going_along([Part("a", told)], session()):
        raise KeyError
    assert told == ["begin a", "end a"]


def test_a_part_that_cannot_begin_is_ended_too_as_it_may_hold_something():
    told: list[str] = []
    parts = [Part("a", told), Part("b", told, failing=True), Part("c", told)]
    with pytest.raises(ZeroDivisionError), going_along(parts, session()):
        told.append("run")
    assert told == ["begin a", "begin b", "end b", "end a"]
