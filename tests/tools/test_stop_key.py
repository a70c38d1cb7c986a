from __future__ import annotations

import os
import threading

import pytest

from tools.stop_key import on_enter


@pytest.fixture
def terminal():
    """A pseudo-terminal: the end that types, and the end that a command has."""
    keyboard, screen = os.openpty()
    yield keyboard, screen
    for descriptor in (keyboard, screen):
        os.close(descriptor)


def test_enter_acts_each_time(terminal):
    keyboard, screen = terminal
    pressed = threading.Semaphore(0)
    with on_enter(pressed.release, screen) as listens:
        assert listens
        os.write(keyboard, b"\n")
        assert pressed.acquire(timeout=10.0)
        os.write(keyboard, b"stop!\n")
        assert pressed.acquire(timeout=10.0)
    os.write(keyboard, b"\n")
    assert not pressed.acquire(timeout=0.3)


def test_without_a_terminal_nothing_is_read():
    reading, writing = os.pipe()
    try:
        with on_enter(lambda: None, reading) as listens:
            assert not listens
        os.write(writing, b"x")
        assert os.read(reading, 1) == b"x"
    finally:
        os.close(reading)
        os.close(writing)
