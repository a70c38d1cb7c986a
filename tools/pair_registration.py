"""Registrations of many pairs: by which method, in several processes, none of them twice."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import cv2

from fusion.algorithm3 import Algorithm3Settings
from fusion.registration import Method, register, warm_up
from mapping.grid import OccupancyGrid
from tools.pair_cache import FinishedPair, PairCache, exact_hash
from tools.processes import as_finished
from tools.results import Report

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Registration:
    """How maps are registered; the settings count for the method of the thesis."""

    method: Method
    settings: Algorithm3Settings
    seed: int

    def settings_report(self) -> Report | None:
        """Return the thesis's settings for JSON; None for a method without any."""
        if self.method != "thesis":
            return None
        alpha = "auto" if self.settings.alpha is None else self.settings.alpha
        return asdict(self.settings) | {"alpha": alpha, "features": self.settings.features.name}

    def label(self) -> str:
        """Return what a registration's result depends on beside the maps: method, settings, seed, program version."""
        settings = json.dumps(self.settings_report(), sort_keys=True, default=str)
        return f"{version('mapfuse-robot')} {self.method} {self.seed} {settings}"


class PairRegistration:
    """Registers pairs of named maps, several at a time; what a cache file holds is not registered again.

    on_progress: told, after each pair, how many of a batch are done, and of how many. taken: of the pairs so far, how
    many came from the file, and the seconds that the others took, summed over all processes.
    """

    def __init__(
        self, registration: Registration, cache: Path | None, jobs: int, on_progress: Callable[[int, int], None]
    ) -> None:
        self._registration = registration
        self._cache = PairCache(cache, registration.label())
        self._jobs = jobs
        self._on_progress = on_progress
        self._hashes: dict[int, tuple[OccupancyGrid, str]] = {}
        self.registered, self.taken, self.seconds = 0, 0, 0.0

    def finish(self, maps: Mapping[str, OccupancyGrid], pairs: Sequence[Pair]) -> dict[Pair, FinishedPair]:
        """Return the registrations of pairs, each written to the cache as soon as it is done."""
        keys = {(a, b): self._cache.key(self._hash(maps[a]), self._hash(maps[b])) for a, b in pairs}
        found = {pair: known for pair, key in keys.items() if (known := self._cache.get(key)) is not None}
        self.taken += len(found)
        todo = {pair: (maps[pair[0]], maps[pair[1]]) for pair in pairs if pair not in found}
        method = self._registration.method
        work = partial(timed_register, registration=self._registration)
        here = partial(warm_up, method)
        for pair, finished in as_finished(work, todo, jobs=self._jobs, first=(_prepare, (method,)), here=here):
            self._cache.add(keys[pair], finished)
            found[pair] = finished
            self.registered += 1
            self.seconds += finished.seconds
            self._on_progress(len(found), len(pairs))
        return {pair: found[pair] for pair in pairs}

    def _hash(self, grid: OccupancyGrid) -> str:
        """Return a grid's hash, made once; the grid is kept, so that its id stays its own."""
        if id(grid) not in self._hashes:
            self._hashes[id(grid)] = grid, exact_hash(grid)
        return self._hashes[id(grid)][1]


def timed_register(a: OccupancyGrid, b: OccupancyGrid, registration: Registration) -> FinishedPair:
    """Register two maps and take the time."""
    started = time.perf_counter()
    alignment = register(a, b, registration.method, registration.seed, registration.settings)
    return FinishedPair(alignment, time.perf_counter() - started)


def _prepare(method: Method) -> None:
    """Make a new process ready: one thread, loaded code, and deaf to Ctrl-C, which is for the process that waits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    warm_up(method)
