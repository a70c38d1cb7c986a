"""Which of many maps look alike, in several processes: what a set of hundreds of maps needs before the first pair."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2

from fusion.map_set import MapSet, in_order
from fusion.retrieval import MapSignature, resemblance, signature
from mapping.grid import OccupancyGrid
from tools.processes import in_processes
from tools.progress_line import ProgressLine

Pair = tuple[str, str]
_BLOCK = 12  # maps against so many others are one task: less than a second of work


def with_looks(maps: MapSet, new: Mapping[str, OccupancyGrid], jobs: int) -> MapSet:
    """Return a set that holds no map yet, with what it will need to know of new ones; as it is if it needs nothing.

    The same follows as without this; it is only sooner there. jobs: processes.
    """
    assert not maps.maps
    if len(new) <= maps.retrieval.all_pairs:
        return maps
    names = in_order(new)
    signatures: dict[str, MapSignature] = {}
    with ProgressLine("looked at {done} of {count} maps") as progress:
        made = in_processes(signature, [new[name] for name in names], jobs=jobs, first=_ONE_THREAD)
        for name, each in zip(names, made, strict=True):
            signatures[name] = each
            progress.tell(len(signatures), len(names))
    blocks = [names[first : first + _BLOCK] for first in range(0, len(names), _BLOCK)]
    tasks = list(itertools.combinations_with_replacement(blocks, 2))
    sides = [[{name: signatures[name] for name in task[side]} for task in tasks] for side in (0, 1)]
    alike: dict[Pair, float] = {}
    with ProgressLine("compared the looks of {done} of {count} blocks of maps") as progress:
        for done, found in enumerate(in_processes(_resemblances, *sides, jobs=jobs, first=_ONE_THREAD), start=1):
            alike |= found
            progress.tell(done, len(tasks))
    return replace(maps, signatures=signatures, alike=alike)


def _resemblances(some: Mapping[str, MapSignature], others: Mapping[str, MapSignature]) -> dict[Pair, float]:
    """Return how alike each map of a block is to each later one of another block, or of the same one."""
    same = list(some) == list(others)
    pairs: Sequence[Pair] = list(itertools.combinations(some, 2) if same else itertools.product(some, others))
    return {(a, b): resemblance(some[a], others[b]) for a, b in pairs}


def _use_one_thread() -> None:
    cv2.setNumThreads(1)


_ONE_THREAD = (_use_one_thread, ())
