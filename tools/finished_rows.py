"""Rows of a long experiment in a file, a line a row, so that a run that was interrupted goes on where it was."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tools.processes import as_finished
from tools.results import Report, writing_to

log = logging.getLogger(__name__)


class FinishedRows:
    """Rows by their keys; a line that is not whole, the last one of a run that was killed, is left out.

    settings: what rows depend on beside their keys; rows of other settings are left out as well.
    """

    def __init__(self, path: Path, settings: str) -> None:
        self._path = path
        self._settings = settings
        self._rows: dict[str, Report] = {}
        if path.exists():
            with writing_to(path):
                lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
            for line in lines:
                self._take(line)

    def get(self, key: str) -> Report | None:
        """Return the row, if it has been finished."""
        return self._rows.get(key)

    def add(self, key: str, row: Report) -> None:
        """Keep a row; it is in the file when this returns. Raises ToolError where it cannot be written."""
        self._rows[key] = row
        line = json.dumps({"settings": self._settings, "key": key, "row": row})
        with writing_to(self._path):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(f"\n{line}\n")  # what a killed run left of a line ends here
                file.flush()
                os.fsync(file.fileno())

    def _take(self, line: str) -> None:
        try:
            entry: Any = json.loads(line)
            settings, key, row = entry["settings"], entry["key"], entry["row"]
        except (ValueError, KeyError, TypeError):
            return
        if settings == self._settings and isinstance(key, str) and isinstance(row, dict):
            self._rows[key] = row


def finish_rows(
    rows: FinishedRows,
    work: Callable[..., Report],
    tasks: Mapping[str, Sequence[Any]],
    jobs: int,
    name: str,
) -> dict[str, Report]:
    """Return the rows of all tasks, work(*arguments) of each by its key, in their order; those finished are not redone.

    work: a function of a module where jobs, the number of processes, is above 1. One thread a process. Progress is
    logged under the name.
    """
    left = {key: arguments for key, arguments in tasks.items() if rows.get(key) is None}
    done = len(tasks) - len(left)
    for key, row in as_finished(work, left, jobs=jobs, first=(use_one_thread, ()), here=use_one_thread):
        rows.add(key, row)
        done += 1
        log.info("%s: %d of %d: %s", name, done, len(tasks), key)
    return {key: found for key in tasks if (found := rows.get(key)) is not None}


def use_one_thread() -> None:
    """Let OpenCV work in one thread: times of one process do not hang on how many cores are idle."""
    import cv2

    cv2.setNumThreads(1)
