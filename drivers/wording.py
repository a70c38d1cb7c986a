"""Numbers of things in messages."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """Return `1 file`, `2 files`, `0 files`: nouns that take an s."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
