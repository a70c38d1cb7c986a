"""What a program that serves until it is stopped tells on stdout: one line an event, as text or as JSON."""

from __future__ import annotations

import json
import sys


def announce(as_json: bool, event: str, **details: object) -> None:
    """Print one event as one line, at once."""
    if as_json:
        text = json.dumps({"event": event, **details})
    else:
        text = "  ".join([event, *(f"{key} {value}" for key, value in details.items())])
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
