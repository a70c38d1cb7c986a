"""One process from its start to its end."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest

from planning.cancel_flag import CancelFlag
from planning.costmap import UnknownSpace
from planning.errors import PlanningError, WorkerError
from planning.plan import PlanSettings
from planning.vehicle import Vehicle
from planning.worker_link import LateError, WorkerLink
from planning.worker_process import MapReady, NewMap, Order


@pytest.fixture
def link() -> Iterator[WorkerLink]:
    wake, waker = socket.socketpair()
    with CancelFlag() as flag, wake, waker:
        link = WorkerLink(time.monotonic, flag, wake)
        yield link
        link.kill()
        link.kill()
        assert link.reap(10.0)
        assert not link.is_alive


def test_questions_answers_and_death(link, rooms):
    with pytest.raises(LateError):
        link.await_start(0.0)
    assert link.await_start(120.0).seconds > 0.0

    link.send(1, NewMap(rooms, Vehicle(), UnknownSpace.forbidden))
    assert isinstance(link.answer(1, 60.0), MapReady)
    link.send(2, Order(np.full(3, np.nan), np.zeros(3), PlanSettings(), 1))
    with pytest.raises(PlanningError, match="not a finite pose"):
        link.answer(2, 60.0)
    link.send(3, Order(np.zeros(2), np.zeros(3), PlanSettings(), 1))
    with pytest.raises(RuntimeError, match=r"(?s)in the planning process.*Traceback"):
        link.answer(3, 60.0)
    # An answer that nobody waited for is not taken for the next one.
    for number in (4, 5):
        link.send(number, NewMap(rooms, Vehicle(), UnknownSpace.free))
    assert isinstance(link.answer(5, 60.0), MapReady)
    with pytest.raises(LateError) as late:
        link.answer(4, 0.05)
    assert not late.value.cancelled

    os.kill(link.pid, signal.SIGKILL)
    with pytest.raises(WorkerError, match="killed by signal 9"):
        link.answer(6, 60.0)
    with pytest.raises(WorkerError):
        link.send(7, NewMap(rooms, Vehicle(), UnknownSpace.free))


def test_a_cancelled_number_ends_the_wait_after_its_patience():
    wake, waker = socket.socketpair()
    with CancelFlag() as flag, wake, waker:
        link = WorkerLink(time.monotonic, flag, wake)
        flag.cancel(1)
        waker.send(b"x")
        with pytest.raises(LateError) as late:
            link.await_start(60.0, 1)  # far from started
        assert late.value.cancelled
        link.kill()
        assert link.reap(10.0)
