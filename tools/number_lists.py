"""Lists of numbers on the command line, such as 8,20."""

from __future__ import annotations

from typing import TypeVar

from tools.errors import UsageError

Number = TypeVar("Number", int, float)
_MOST = 1000


def positive_numbers(text: str, kind: type[Number], option: str) -> tuple[Number, ...]:
    """Return the positive numbers of a list, each once, rising; raise UsageError."""
    try:
        numbers = sorted({kind(part) for part in text.split(",")})
    except ValueError:
        numbers = []
    if not numbers or numbers[0] <= 0 or not numbers[-1] <= _MOST:
        raise UsageError(f"{option}: {text!r} is no list of positive {kind.__name__} numbers; write them as 8,20")
    return tuple(numbers)
