"""Questions that only show whether we are heard, and how long they have been without an answer."""

from types import SimpleNamespace

import pytest

from drivers.mavlink_echo import Echo

MS = 1_000_000


def answer(ts1: int, tc1: int = 7):
    return SimpleNamespace(tc1=tc1, ts1=ts1)


def asked(*times_ms: int) -> Echo:
    echo = Echo(100 * MS)
    for time_ms in times_ms:
        assert echo.question(time_ms * MS) == {"tc1": 0, "ts1": time_ms * MS}
    return echo


def test_a_question_is_due_at_its_interval() -> None:
    echo = asked(50)
    assert echo.question(149 * MS) is None
    assert echo.question(150 * MS) is not None


def test_who_never_answers_is_not_said_to_be_deaf() -> None:
    assert asked(*range(0, 10_000, 100)).unanswered_s(10_000 * MS) == 0.0


def test_the_oldest_question_without_a_later_answer_counts() -> None:
    echo = asked(0, 100, 200, 300)
    echo.hear(answer(100 * MS))  # the first answer got lost, which says nothing
    assert echo.unanswered_s(350 * MS) == pytest.approx(0.15)
    echo.hear(answer(300 * MS))
    assert echo.unanswered_s(350 * MS) == 0.0


def test_a_process_that_was_stuck_does_not_call_the_vehicle_deaf() -> None:
    echo = asked(0)
    echo.hear(answer(0))
    assert echo.question(100 * MS)
    assert echo.question(3000 * MS)  # stuck in between: the answer waited in the line
    echo.hear(answer(100 * MS))
    assert echo.unanswered_s(3020 * MS) == pytest.approx(0.02)


def test_the_vehicles_own_questions_and_answers_to_others_are_no_answers() -> None:
    echo = asked(0)
    echo.hear(answer(0, tc1=0))
    echo.hear(answer(5 * MS))
    assert echo.unanswered_s(500 * MS) == 0.0


def test_after_a_long_silence_it_is_known_how_long_it_was_and_an_answer_ends_it() -> None:
    echo = asked(0)
    echo.hear(answer(0))
    for time_ms in range(100, 60_100, 100):
        echo.question(time_ms * MS)
    assert echo.unanswered_s(60_100 * MS) == pytest.approx(60.0)
    echo.hear(answer(60_000 * MS))
    assert echo.unanswered_s(60_100 * MS) == 0.0
