from __future__ import annotations

import os
import signal
import threading
import time

from tools.bell import Bell


def test_what_was_rung_is_heard_once_and_in_order():
    with Bell() as bell:
        assert bell.wait(0.0) == ()
        bell.ring(3)
        bell.ring(200)
        assert bell.wait(1.0) == (3, 200)
        assert bell.wait(0.0) == ()


def test_a_thread_that_waits_is_woken():
    with Bell() as bell:
        threading.Timer(0.05, bell.ring, (7,)).start()
        assert bell.wait(10.0) == (7,)


def test_ringing_a_full_or_closed_bell_does_no_harm():
    bell = Bell()
    for _ in range(200_000):
        bell.ring(1)
    assert set(bell.wait(0.0)) == {1}
    bell.close()
    bell.ring(1)


def test_a_signal_rings_while_the_main_thread_has_no_time_for_its_handler():
    heard: list[tuple[float, tuple[int, ...]]] = []

    def listen(bell):
        heard.append((time.monotonic(), bell.wait(10.0)))
        heard.append((time.monotonic(), ()))

    with Bell() as bell, bell.rung_by_signals([signal.SIGUSR1]):
        thread = threading.Thread(target=listen, args=(bell,))
        thread.start()
        os.kill(os.getpid(), signal.SIGUSR1)
        thread.join()
    assert heard[0][1] == (signal.SIGUSR1,)


def test_the_former_handlers_return():
    before = signal.getsignal(signal.SIGUSR1)
    with Bell() as bell, bell.rung_by_signals([signal.SIGUSR1]):
        assert signal.getsignal(signal.SIGUSR1) != before
    assert signal.getsignal(signal.SIGUSR1) == before
    assert signal.set_wakeup_fd(-1) == -1
