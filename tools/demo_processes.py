"""Commands of this program as processes that are watched: whatever happens, none is left behind."""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from tools.errors import ToolError
from tools.processes import own_command

_POLL_S = 0.1
PATIENCE_S = 300.0  # for each step of starting up, and for saving: a small computer compiles what is compiled first
_GRACE_S = 20.0
Stopped = Callable[[], bool]


class CommandProcess:
    """A command of this program as a process, and its JSON events."""

    def __init__(self, name: str, arguments: Sequence[str]) -> None:
        self.name = name
        command = own_command(arguments)
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own program
        self._lines: queue.Queue[str] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def code(self) -> int | None:
        """The exit code; None while it runs."""
        return self._process.poll()

    def event(
        self, wanted: str, patience_s: float, watched: Sequence[CommandProcess], stopped: Stopped
    ) -> dict[str, object]:
        """Wait for an event; raises ToolError if it does not come, or a watched process ends before."""
        ends_at = time.monotonic() + patience_s
        while time.monotonic() < ends_at:
            _check(stopped)
            try:
                event: dict[str, object] = json.loads(self._lines.get(timeout=_POLL_S))
            except queue.Empty:
                for process in (self, *watched):
                    if process.code is not None and self._lines.empty():
                        raise ToolError(
                            f"{process.name} ended with exit code {process.code} before '{wanted}': see above"
                        ) from None
                continue
            if event["event"] == wanted:
                return event
        raise ToolError(f"{self.name}: no '{wanted}' within {patience_s:.0f} s")

    def interrupt(self) -> None:
        """Press Ctrl-C for it."""
        if self.code is None:
            self._process.send_signal(signal.SIGINT)

    def wait(self, patience_s: float, stopped: Stopped) -> int:
        """Wait for its end and return the exit code; raises ToolError if it takes too long."""
        ends_at = time.monotonic() + patience_s
        while self.code is None and time.monotonic() < ends_at:
            _check(stopped)
            time.sleep(_POLL_S)
        if self.code is None:
            raise ToolError(f"{self.name} did not end within {patience_s:.0f} s")
        return self.code

    def close(self) -> None:
        """End it, gently at first."""
        for end in (self._process.terminate, self._process.kill):
            if self.code is None:
                end()
                try:
                    self._process.wait(_GRACE_S)
                except subprocess.TimeoutExpired:
                    continue
        self._reader.join()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)


def run_command(stopped: Stopped, *arguments: str, allowed: Sequence[int] = (0,)) -> int:
    """Run a command of this program to its end and return its exit code; raises ToolError for one not allowed."""
    with command_processes() as start:
        code = start(f"mapfuse-robot {arguments[0]}", arguments).wait(10 * PATIENCE_S, stopped)
    if code not in allowed:
        raise ToolError(f"mapfuse-robot {arguments[0]} failed with exit code {code}: see above")
    return code


@contextmanager
def command_processes() -> Iterator[Callable[[str, Sequence[str]], CommandProcess]]:
    """Yield a function that starts processes; all of them have ended when the block is left."""
    started: list[CommandProcess] = []

    def start(name: str, arguments: Sequence[str]) -> CommandProcess:
        started.append(CommandProcess(name, arguments))
        return started[-1]

    try:
        yield start
    finally:
        for process in reversed(started):
            process.close()


def _check(stopped: Stopped) -> None:
    if stopped():
        raise KeyboardInterrupt
