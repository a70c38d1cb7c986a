"""What all tests share: where the project and the real recordings are, how long hypothesis searches, who runs alone."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Generator
from contextlib import ExitStack
from fcntl import LOCK_EX, LOCK_SH, LOCK_UN, flock
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

PROJECT_ROOT = Path(__file__).resolve().parent.parent
WORKER = os.environ.get("PYTEST_XDIST_WORKER")  # gw0, gw1, ...; None where pytest runs without pytest-xdist's -n
WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))

# The processes of one run, and those that they start, share what numba compiles.
COMPILED = PROJECT_ROOT / ".pytest_cache" / "numba"
if WORKER is not None:
    os.environ["NUMBA_CACHE_DIR"] = str(COMPILED)
    # They share the cores too: threads of one that spin while the other's compute made learning take 20 times as long.
    os.environ.setdefault("OMP_NUM_THREADS", "1")

# No deadline and no speed check: a shared host may stall for a moment, and that is no fault of the code.
settings.register_profile("local", deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("ci", settings.get_profile("local"), derandomize=True, database=None)
settings.load_profile("ci" if os.environ.get("CI") else "local")


@pytest.fixture(scope="session")
def project_root() -> Path:
    """The folder with pyproject.toml."""
    return PROJECT_ROOT


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings: MAPFUSE_DATA (relative to the project) or ../shared/data; skips where absent."""
    folder = (PROJECT_ROOT / (os.environ.get("MAPFUSE_DATA") or "../shared/data")).resolve()
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}: set MAPFUSE_DATA to their folder")
    return folder


def pytest_configure(config: pytest.Config) -> None:
    """Let the workers of pytest-xdist take turns, and compile for each other."""
    if WORKER is not None:
        compile_in_turns(COMPILED / "turns")
        config.pluginmanager.register(Turns(os.environ["PYTEST_XDIST_TESTRUNUID"]))


def compile_in_turns(folder: Path) -> None:
    """Let one process compile a function, while another that needs it waits and then loads it.

    numba numbers the files of its cache without a lock: two processes that compile a function for different arguments
    at the same time may take the same file, and would then load each other's machine code.
    """
    from numba.core.caching import NullCache
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    folder.mkdir(parents=True, exist_ok=True)
    functions: Any = Dispatcher  # numba's types do not know what is used here
    compile_now, busy = functions.compile, set[str]()

    def compile_in_turn(self: Any, signature: object) -> object:
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
        with global_compiler_lock, ExitStack() as turn:  # of threads, and then of processes
            # What is not saved is not waited for, nor is a function within its own compilation.
            if not isinstance(self._cache, NullCache) and name not in busy:
                busy.add(name)
                turn.callback(busy.remove, name)
                file = turn.enter_context((folder / name).open("w"))
                flock(file, LOCK_EX)
            return compile_now(self, signature)

    functions.compile = compile_in_turn


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Refuse a test that reads real data without saying so: `-m "not real_data"` would not leave it out.

    Among several processes those that run alone come last.
    """
    for item in items:
        if "data_dir" in getattr(item, "fixturenames", ()) and item.get_closest_marker("real_data") is None:
            raise pytest.UsageError(f"{item.nodeid} uses data_dir: mark it with @pytest.mark.real_data")
    if WORKER is not None:
        items.sort(key=runs_alone)


def runs_alone(item: pytest.Item) -> bool:
    """Whether a test needs more than its share of the computer to keep the pace of a real sensor."""
    live = item.get_closest_marker("live")
    if live is None:
        return False
    return live.kwargs.get("cores") != 1 or len(os.sched_getaffinity(0)) < WORKERS


class Turns:
    """Some live tests run alone: no other process of the same run of pytest-xdist tests anything at that time.

    All tests share the floor, such a one takes it for itself. Who waits for the floor holds the gate, so that nobody
    comes in before; such tests in a row keep both. The system gives the locks of a process that dies back.
    """

    def __init__(self, run: str) -> None:
        """run: the name that all processes of the run know."""
        folder = Path(tempfile.gettempdir())
        self._files = [folder / f"mapfuse-robot-tests-{run}-{name}" for name in ("gate", "floor")]
        self._gate, self._floor = (os.open(file, os.O_RDWR | os.O_CREAT, 0o600) for file in self._files)
        self._alone = False

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> Generator[None, object, object]:
        """Wait for the turn of a test, run it, and let the others go on."""
        alone = runs_alone(item)
        if not self._alone:
            flock(self._gate, LOCK_EX if alone else LOCK_SH)
            flock(self._floor, LOCK_EX if alone else LOCK_SH)
        if not alone:
            flock(self._gate, LOCK_UN)
        try:
            return (yield)
        finally:
            self._alone = alone and nextitem is not None and runs_alone(nextitem)
            if not self._alone:
                flock(self._floor, LOCK_UN)
                flock(self._gate, LOCK_UN)

    def pytest_unconfigure(self) -> None:
        """Leave no files; who still runs has them open."""
        for file in self._files:
            file.unlink(missing_ok=True)
