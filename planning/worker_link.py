"""The parent's end of a process that plans: start it, ask, wait for the answer, kill it."""

from __future__ import annotations

import socket
import subprocess
import sys
from contextlib import suppress
from multiprocessing.connection import Connection, wait

from planning.cancel_flag import CancelFlag
from planning.errors import PlanningError, WorkerError
from planning.worker_process import START_NUMBER, Clock, Refusal, Request, WarmUp

_CANCEL_S = 0.02  # how long a cancelled search may take to end by itself
_PROGRAM = (
    "import sys; sys.path[:] = sys.argv[3:]; from planning.worker_process import serve; "
    "serve(int(sys.argv[1]), int(sys.argv[2]))"
)


class LateError(Exception):
    """No answer in time; cancelled: because none is wanted any more."""

    def __init__(self, *, cancelled: bool) -> None:
        super().__init__("cancelled" if cancelled else "late")
        self.cancelled = cancelled


class WorkerLink:
    """One process, from its start to its end; for one thread at a time.

    A fresh interpreter and not a fork, which threads do not survive; in a session of its own, where the terminal's
    Ctrl-C does not reach it. flag: what it looks at to see whether a search is still wanted. wake: readable when that
    changes.
    """

    def __init__(self, clock: Clock, flag: CancelFlag, wake: socket.socket) -> None:
        self._clock, self._flag, self._wake = clock, flag, wake
        self._warm_up: WarmUp | None = None
        ours, theirs = socket.socketpair()
        self._connection: Connection = Connection(ours.detach())
        with theirs:
            descriptors = (theirs.fileno(), flag.descriptor)
            try:
                self._process = subprocess.Popen(  # noqa: S603 - this interpreter, our own program
                    [sys.executable, "-c", _PROGRAM, *map(str, descriptors), *sys.path],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    pass_fds=descriptors,
                    start_new_session=True,
                )
            except OSError as error:
                self._connection.close()
                raise WorkerError(f"the planning process cannot be started: {error}") from error
        self.send(START_NUMBER, (clock, clock()))

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def await_start(self, limit_s: float, wanted: int | None = None) -> WarmUp:
        """Wait until the process can plan; as `answer`."""
        if self._warm_up is None:
            answer = self.answer(START_NUMBER, limit_s, wanted, patience_s=0.0)
            assert isinstance(answer, WarmUp)
            self._warm_up = answer
        return self._warm_up

    def send(self, number: int, request: Request | tuple[Clock, float]) -> None:
        """Send a request; raises WorkerError where nobody is there."""
        try:
            self._connection.send((number, request) if number != START_NUMBER else request)
        except OSError as error:
            raise WorkerError(self._epitaph()) from error

    def answer(
        self, number: int, limit_s: float, wanted: int | None = None, *, patience_s: float = _CANCEL_S
    ) -> object:
        """Wait for the answer to a request; those to earlier ones are dropped.

        wanted: the number whose cancelling ends the wait after patience_s. Raises LateError; WorkerError where the
        process dies; PlanningError where it refuses; RuntimeError, with the other process's traceback, for what nobody
        has foreseen.
        """
        ends_s, cancelled = self._clock() + limit_s, False
        while True:
            if wanted is not None and not cancelled and self._flag.is_cancelled(wanted):
                ends_s, cancelled = min(ends_s, self._clock() + patience_s), True
            readable = wait([self._connection, self._wake], max(0.0, ends_s - self._clock()))
            if self._wake in readable:
                self._wake.recv(4096)
            if self._connection in readable:
                answered, answer = self._receive()
                if answered == number:
                    return _accepted(answer)
            elif not readable:
                raise LateError(cancelled=cancelled)

    def kill(self) -> None:
        """End the process at once; `reap` waits for that. Killing twice is allowed."""
        self._process.kill()
        self._connection.close()

    def reap(self, timeout_s: float | None = None) -> bool:
        """Wait for a killed process, so that no trace of it is left; return whether it is gone."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        return self._process.returncode is not None

    def _receive(self) -> tuple[int, object]:
        try:
            number, answer = self._connection.recv()
        except (EOFError, OSError) as error:
            raise WorkerError(self._epitaph()) from error
        return number, answer

    def _epitaph(self) -> str:
        """Say how the process ended; it is ending, if it has not."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        code = self._process.returncode
        how = "hung up" if code is None else f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
        why = ": out of memory?" if code == -9 else "; what it said is on stderr" if code else ""
        return f"the planning process {how}{why}; plan again, another one is started"


def _accepted(answer: object) -> object:
    if isinstance(answer, Refusal):
        if answer.foreseen:
            raise PlanningError(answer.text)
        raise RuntimeError(f"in the planning process:\n{answer.text}")  # noqa: TRY004 - nobody passed a wrong type
    return answer
