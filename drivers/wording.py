"""Numbers and faults in messages."""

from __future__ import annotations

_LONGEST = 160  # characters; some errors recite the whole file


def counted(count: int, noun: str) -> str:
    """Return `1 file`, `2 files`, `0 files`: nouns that take an s."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def fault_in(error: Exception) -> str:
    """Return on one short line, in words, what an error found in a file."""
    if isinstance(error, UnicodeDecodeError):
        return "it is no text"
    if isinstance(error, KeyError):
        return f"{error} is missing"
    text = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else line[:_LONGEST] + "..."
