from __future__ import annotations

import threading

from drivers.newest_queue import NewestQueue


def test_a_full_queue_drops_the_oldest_and_counts() -> None:
    queue: NewestQueue[int] = NewestQueue(3)
    for number in range(5):
        queue.put(number)
    assert queue.dropped == 2
    assert [queue.take(0.0) for _ in range(4)] == [2, 3, 4, None]


def test_the_newest_item_lets_the_others_go() -> None:
    queue: NewestQueue[int] = NewestQueue(3)
    for number in range(3):
        queue.put(number)
    assert queue.take_newest(0.0) == 2
    assert queue.take_newest(0.0) is None
    assert queue.dropped == 0


def test_taking_waits_for_an_item() -> None:
    queue: NewestQueue[str] = NewestQueue(1)
    timer = threading.Timer(0.05, queue.put, ("late",))
    timer.start()
    assert queue.take(5.0) == "late"
    timer.join()
