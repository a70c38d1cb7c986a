"""Work in processes of its own, one after the other or several at once; what a process takes."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar

from tools.errors import ToolError

Result = TypeVar("Result")
Key = TypeVar("Key", bound=Hashable)

# The package is found beside this file even where the current folder has one called `tools` too.
_HOME = str(Path(__file__).resolve().parent.parent)
ENTRY = f"import sys; sys.path.insert(0, {_HOME!r}); from tools.cli import main; main()"
_STATUS = Path("/proc/self/status")
_CLEAR_PEAK = Path("/proc/self/clear_refs")


def own_command(arguments: Sequence[str]) -> list[str]:
    """Return what starts this program with arguments."""
    return [sys.executable, "-c", ENTRY, *arguments]


def in_own_process(work: Callable[..., Result], *arguments: object) -> Result:
    """Return work(*arguments), done in a fresh process; its exceptions are raised here.

    work must be a function of a module. Raises ToolError when the process dies, for want of memory for instance.
    """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(work, *arguments).result()
        except BrokenProcessPool as error:
            raise ToolError(
                "a measuring process died: out of memory? Free some, or measure a shorter recording"
            ) from error


First = tuple[Callable[..., object], tuple[Any, ...]]


def in_processes(
    work: Callable[..., Result], *tasks: Sequence[Any], jobs: int, first: First | None = None
) -> Iterator[Result]:
    """Yield work of each task in their order, as map does, in so many fresh processes; one task or job is done here.

    work: a function of a module, or a partial of one. first: what each new process does before, and its arguments.
    Raises ToolError when a process dies.
    """
    if _is_done_here(jobs, len(tasks[0])):
        yield from map(work, *tasks)
        return
    with _pool(jobs, first) as processes:
        yield from processes.map(work, *tasks)


def as_finished(
    work: Callable[..., Result],
    tasks: Mapping[Key, Sequence[Any]],
    *,
    jobs: int,
    first: First,
    here: Callable[[], object],
) -> Iterator[tuple[Key, Result]]:
    """Yield each task's key and work(*arguments) as soon as it is finished, in so many fresh processes.

    One task or job is done here, after `here` instead of `first`, which each new process does before. Raises ToolError
    when a process dies; whatever ends this, tasks that have not begun are left out.
    """
    if _is_done_here(jobs, len(tasks)):
        if tasks:
            here()
        yield from ((key, work(*arguments)) for key, arguments in tasks.items())
        return
    waiting, running = iter(tasks.items()), dict[Future[Result], Key]()
    with _pool(min(jobs, len(tasks)), first) as processes:
        while True:
            for key, arguments in itertools.islice(waiting, 2 * jobs - len(running)):
                running[processes.submit(work, *arguments)] = key
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()


def _is_done_here(jobs: int, tasks: int) -> bool:
    return jobs <= 1 or tasks < 2


@contextmanager
def _pool(jobs: int, first: First | None) -> Iterator[ProcessPoolExecutor]:
    """Yield so many fresh processes; tasks that have not begun at the end are left out."""
    context = multiprocessing.get_context("spawn")
    processes = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin, initargs=first or (None, ()))
    try:
        yield processes
    except BrokenProcessPool as error:
        raise ToolError("a process died: out of memory? Free some, or allow fewer --jobs") from error
    finally:
        processes.shutdown(cancel_futures=True)


def _begin(prepare: Callable[..., object] | None, arguments: tuple[Any, ...]) -> None:
    """Prepare a new process, which ends when the one that it works for was killed: nothing else would tell it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if prepare is not None:
        prepare(*arguments)


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory of this process in MB (1e6 bytes): now, and the most since the start or the last reset."""

    resident_mb: float
    peak_mb: float


def memory() -> Memory:
    """Return what this process holds (VmRSS and VmHWM of proc(5)); nan where the system has no /proc."""
    try:
        fields = dict(line.split(":", 1) for line in _STATUS.read_text(encoding="ascii").splitlines() if ":" in line)
        resident, peak = (float(fields[name].split()[0]) * 1024e-6 for name in ("VmRSS", "VmHWM"))
    except (OSError, KeyError):
        return Memory(float("nan"), float("nan"))
    return Memory(resident, peak)


def reset_peak() -> bool:
    """Let the peak begin anew (proc(5): clear_refs); False where the system does not let a process do that."""
    try:
        descriptor = os.open(_CLEAR_PEAK, os.O_WRONLY)
    except OSError:
        return False
    try:
        os.write(descriptor, b"5")
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def thread_times() -> dict[str, float]:
    """Return the CPU seconds so far of this process's Python threads, by their names up to the first underscore."""
    times: dict[str, float] = {}
    for thread in threading.enumerate():
        if thread.ident is not None:
            name = thread.name.partition("_")[0]
            times[name] = times.get(name, 0.0) + time.clock_gettime(time.pthread_getcpuclockid(thread.ident))
    return times


def limit_to(cores: int) -> int:
    """Let this process, and what it starts, run on so many cores at the most; return how many it has."""
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    os.sched_setaffinity(0, allowed)
    return len(allowed)
