"""The thread that commands, in real time, with a vehicle that keeps what it is told."""

from __future__ import annotations

import logging
import signal
import threading
import time

import pytest

from drivers.vehicle import DriveCommand, NullVehicle
from tools.bell import Bell
from tools.drive_thread import HANGING, KEY, WATCH_S, DriveThread

pytestmark = pytest.mark.live(cores=1)
FAST = DriveCommand(0.5, 0.0)


class ToldVehicle(NullVehicle):
    """Writes down with the time what changes what it does."""

    def __init__(self):
        super().__init__(time.monotonic_ns)
        self.told: list[tuple[float, str]] = []

    def _note(self, what):
        self.told.append((time.monotonic(), what))

    def disarm(self):
        self._note("disarm")
        super().disarm()

    def stop(self):
        self._note("stop")
        super().stop()

    def emergency_stop(self):
        self._note("cut")
        super().emergency_stop()

    def words(self):
        return [what for _, what in self.told]


class Driven:
    """Drives fast; fails or hangs from the n-th step on."""

    armed = True
    fault = ""
    left = False

    def __init__(self, vehicle, fails_at=None, hangs_at=None):
        self.vehicle, self.fails_at, self.hangs_at = vehicle, fails_at, hangs_at
        self.steps = 0
        self.stopped = ""
        self.free = threading.Event()

    def step(self, now_ns):
        self.steps += 1
        if self.steps == self.fails_at:
            raise ZeroDivisionError
        if self.steps == self.hangs_at:
            self.free.wait(20.0)
        if not self.stopped:
            self.vehicle.drive(FAST)

    def emergency_stop(self, reason):
        self.stopped = reason


@pytest.fixture
def vehicle():
    vehicle = ToldVehicle()
    vehicle.arm()
    return vehicle


@pytest.fixture
def bell():
    with Bell() as bell:
        yield bell


def started(driven, vehicle, bell, stop=None, **options):
    thread = DriveThread(driven, vehicle, time.monotonic_ns, bell, stop or threading.Event(), **options)
    thread.start()
    wait_for(lambda: driven.steps > 3)
    return thread


def wait_for(reached, seconds=20.0):
    end = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end, "it does not come"
        time.sleep(0.005)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_end_makes_the_car_stand_then_disarms_it(vehicle, bell, number):
    driven = Driven(vehicle)
    thread = started(driven, vehicle, bell)
    assert vehicle.command == FAST
    rung = time.monotonic()
    bell.ring(number)
    wait_for(vehicle.words)
    assert vehicle.told[0][1] == "stop"
    assert vehicle.told[0][0] - rung < 0.05 + 0.15, "50 ms, and what a busy computer takes"
    thread.end()
    assert vehicle.words() == ["stop", "disarm"]
    assert thread.failure is None


def test_the_end_of_the_session_and_a_reached_goal_end_it_likewise(vehicle, bell):
    stop, driven = threading.Event(), Driven(vehicle)
    thread = started(driven, vehicle, bell, stop, after_step=lambda _: driven.steps > 10)
    assert stop.wait(20.0), "the thread ends the session"
    thread.end()
    assert driven.steps == 11
    assert vehicle.words() == ["stop", "disarm"]


@pytest.mark.parametrize(("number", "how"), [(signal.SIGUSR1, "SIGUSR1"), (KEY, "a key")])
def test_an_emergency_stop_cuts_at_once_and_the_thread_goes_on(vehicle, bell, number, how):
    driven = Driven(vehicle)
    thread = started(driven, vehicle, bell)
    bell.ring(number)
    wait_for(vehicle.words)
    assert (vehicle.words(), driven.stopped) == (["cut"], f"by {how}")
    steps = driven.steps
    wait_for(lambda: driven.steps > steps + 3)
    thread.end()


def test_a_thread_that_dies_stops_the_car_and_keeps_what_it_died_of(vehicle, bell):
    stop, driven = threading.Event(), Driven(vehicle, fails_at=5)
    thread = started(driven, vehicle, bell, stop)
    wait_for(lambda: thread.failure is not None)
    wait_for(vehicle.words)
    assert vehicle.words() == ["cut"]
    assert not stop.is_set(), "the session goes on"
    thread.end()
    assert isinstance(thread.failure, ZeroDivisionError)


def test_a_thread_that_hangs_is_noticed_by_the_watch(vehicle, bell):
    driven = Driven(vehicle, hangs_at=5)
    thread = started(driven, vehicle, bell)
    wait_for(vehicle.words)
    assert vehicle.words() == ["cut"]
    assert "hangs" in driven.stopped
    driven.free.set()
    thread.end()


def test_a_car_that_is_not_ours_is_left_alone(vehicle, bell):
    driven = Driven(vehicle)
    thread = started(driven, vehicle, bell)
    driven.fault, driven.left = "the vehicle is in MANUAL: somebody else drives", True
    thread.end()
    assert vehicle.words() == []


def test_a_car_that_a_fault_of_ours_stopped_is_told_to_stand_again_at_the_end(vehicle, bell):
    driven = Driven(vehicle)
    thread = started(driven, vehicle, bell)
    driven.fault = "the vehicle does not follow"
    thread.end()
    assert vehicle.words() == ["stop", "disarm"]


def test_a_car_that_is_armed_only_after_its_thread_has_hung_for_a_while_is_stopped_too(vehicle, bell):
    driven = Driven(vehicle, hangs_at=5)
    driven.armed = False
    thread = started(driven, vehicle, bell)
    wait_for(lambda: driven.steps == 5)
    time.sleep((HANGING + 5) * WATCH_S)
    driven.armed = True
    wait_for(vehicle.words)
    assert vehicle.words() == ["cut"]
    driven.free.set()
    thread.end()


@pytest.mark.parametrize("why", ["hangs", "dies", "key"])
def test_a_log_that_nobody_reads_keeps_nothing_from_stopping_the_car(vehicle, bell, why):
    """A terminal that was stopped by Ctrl-S blocks whoever writes to it."""
    free = threading.Event()

    class Blocking(logging.Handler):
        def emit(self, record):
            free.wait(30.0)

    blocking = Blocking()
    logger = logging.getLogger("tools.drive_thread")
    logger.addHandler(blocking)
    try:
        driven = Driven(vehicle, hangs_at=5 if why == "hangs" else None, fails_at=5 if why == "dies" else None)
        thread = started(driven, vehicle, bell)
        if why == "key":
            bell.ring(KEY)
        wait_for(vehicle.words)
        assert vehicle.words()[0] == "cut"
    finally:
        free.set()
        logger.removeHandler(blocking)
    driven.free.set()
    thread.end()


def test_the_pace_is_kept(vehicle, bell):
    thread = started(Driven(vehicle), vehicle, bell)
    time.sleep(0.5)
    thread.end()
    assert thread.pace.steps > 10
    assert 0.015 < thread.pace.longest_s < 1.0
