"""`evaluate registration`: a registration run on every pair of a list, one row of results each."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment
from fusion.evaluation import error_at_points
from fusion.layered import register_layers
from fusion.ranking import Ranking
from fusion.registration import Method, register
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.errors import UsageError
from tools.hypothesis_pools import HypothesisPool
from tools.pair_files import BANDS, KINDS, MapPair, load_grids, read_pairs
from tools.processes import in_processes
from tools.ranking_learning import Growth, held_out_scores, ranking_without
from tools.registration_scores import summary_of
from tools.results import Report

FloatArray = NDArray[np.float64]
Register = Callable[[OccupancyGrid, OccupancyGrid, int], Alignment]
_PLACES = ("true", "wrong", "same", "other")


def evaluate_registration(
    folder: Path,
    registered: Register | Sequence[Register],
    pairs: Sequence[MapPair],
    seed: int,
    jobs: int,
    on_row: Callable[[Report], None],
) -> Report:
    """Register the pairs of a folder's list; return the summary with a row for each pair, failures included.

    registered: for all pairs, or one for each; a function of a module where jobs, the number of processes, is above 1.
    Raises MapFileError.
    """
    rows = []
    for row in registered_rows(registered, pairs, seed, jobs):
        on_row(row)
        rows.append(row)
    return {"pairs": str(folder), "seed": seed, **summary_of(rows), "rows": rows}


def register_by(method: Method, a: OccupancyGrid, b: OccupancyGrid, seed: int) -> Alignment:
    """Run one of the registration's methods; partial(register_by, "thesis") can be sent to another process."""
    return register(a, b, method, seed)


def register_ranked(ranking: Ranking, a: OccupancyGrid, b: OccupancyGrid, seed: int) -> Alignment:
    """Run the default registration with another ranking than the one that comes with the program."""
    return register_layers(a, b, ranking=ranking, seed=seed)


def left_out_registrations(
    pairs: Sequence[MapPair], pools: Sequence[HypothesisPool], on_progress: Callable[[str], None], jobs: int = 1
) -> list[Register]:
    """Return for each pair the registration whose ranking is learned from the pools that touch neither building.

    The pools are those of these pairs and of any others. Raises ToolError where nothing is left to learn from.
    """
    groups = [frozenset((pair.building_a, pair.building_b)) for pair in pairs]
    held_out = held_out_scores(pools, Growth(), on_progress, jobs)
    rankings = {group: ranking_without(held_out, group) for group in set(groups)}
    return [partial(register_ranked, rankings[group]) for group in groups]


def chosen_pairs(folder: Path, only: Sequence[str], sample: int | None, seed: int) -> list[MapPair]:
    """Read a list and return those pairs that a filter fits, all without one; then a random sample, in their order.

    A filter is words with "/" between, all of which must fit: a kind, a band, a building, true, wrong, and for wrong
    pairs same (building) or other. Raises ToolError, and UsageError for a filter that fits no pair.
    """
    pairs = read_pairs(folder)
    known = {*KINDS, *BANDS, *_PLACES, *(building for pair in pairs for building in (pair.building_a, pair.building_b))}
    filters = [each.split("/") for each in only]
    for word in (word for words in filters for word in words):
        if word not in known:
            raise UsageError(f"--only {word!r}: expected of {', '.join([*KINDS, *BANDS, *_PLACES])}, or a building")
    kept = [pair for pair in pairs if not filters or any(set(words) <= _words(pair) for words in filters)]
    if not kept:
        raise UsageError(f"--only {' '.join(only)}: fits none of the {len(pairs)} pairs of {folder}")
    if sample is None or sample >= len(kept):
        return kept
    numbers = np.random.default_rng(seed).choice(len(kept), sample, replace=False)
    return [kept[number] for number in sorted(numbers.tolist())]


def registered_rows(
    registered: Register | Sequence[Register], pairs: Sequence[MapPair], seed: int, jobs: int
) -> Iterator[Report]:
    """Yield the row of each pair, in their order.

    The first pair is registered once more beforehand in every process: what is compiled at the first use costs no pair
    its time. One thread a process.
    """
    if not pairs:
        return
    each = [registered] * len(pairs) if callable(registered) else registered
    warm_up = (each[0], pairs[0], seed)
    if jobs <= 1 or len(pairs) < 2:
        _warm_up(*warm_up)
    yield from in_processes(partial(registered_row, seed), each, pairs, jobs=jobs, first=(_warm_up, warm_up))


def _warm_up(registered: Register, pair: MapPair, seed: int) -> None:
    cv2.setNumThreads(1)
    registered(*load_grids(pair), seed)


def registered_row(seed: int, registered: Register, pair: MapPair) -> Report:
    """Register one pair and return its row; cpu_s is the processor's time without reading the files."""
    a, b = load_grids(pair)
    started = time.process_time()
    alignment = registered(a, b, seed)
    cpu_s = time.process_time() - started
    return judged(pair, alignment) | {"cpu_s": round(cpu_s, 4)}


def judged(pair: MapPair, alignment: Alignment) -> Report:
    """Return the row of one pair: what it is, what was found, and how far that is from the truth.

    aligned: the best hypothesis is right, accepted or not; never for a wrong pair. nees: the squared error of x, y and
    yaw of an aligned pair in units of its covariance (3 degrees of freedom).
    """
    truth, pose = pair.truth, alignment.T_a_b
    row: Report = {
        "pair": pair.name,
        "kind": pair.kind,
        "band": pair.band,
        "building_a": pair.building_a,
        "building_b": pair.building_b,
        "true": truth is not None,
        "common_free": pair.overlap,
        "common_wall_m": pair.common_wall_m,
        "aligned": False,
        "accepted": alignment.accepted,
        "probability": alignment.probability,
        "acceptance": round(alignment.acceptance, 4),
        "inliers": alignment.inliers,
        "overlap": round(alignment.overlap, 4),
        "rms_m": None,
        "rotation_deg": None,
        "nees": None,
        "T_a_b": None if pose is None else np.asarray(pose).tolist(),
        "reason": alignment.reason,
        "alternatives": [[*each.T_a_b.tolist(), each.probability] for each in alignment.alternatives],
    }
    if truth is not None and pose is not None:
        error = error_at_points(truth.points_a, truth.points_b, pose, truth.T_a_b)
        row["rms_m"], row["rotation_deg"] = round(error.rms_m, 4), round(error.rotation_deg, 4)
        row["aligned"] = error.rms_m <= truth.right_m and error.rotation_deg <= truth.right_deg
        if row["aligned"] and alignment.covariance is not None:
            row["nees"] = _squared_error(pose, truth.T_a_b, alignment.covariance)
    return row


def _words(pair: MapPair) -> set[str]:
    """Return all words that fit a pair in a filter."""
    same = pair.building_a == pair.building_b
    place = {"true"} if pair.truth is not None else {"wrong", "same" if same else "other"}
    return {pair.kind, pair.building_a, pair.building_b, *place, *([pair.band] if pair.band else [])}


def _squared_error(pose: FloatArray, truth: FloatArray, covariance: FloatArray) -> float | None:
    """Return the normalised estimation error squared; None where the covariance has no inverse."""
    error = np.asarray(pose) - truth
    error[2] = float(se2.wrap_angle(error[2]))
    try:
        squared = float(error @ np.linalg.solve(covariance, error))
    except np.linalg.LinAlgError:
        return None
    return round(squared, 3) if math.isfinite(squared) else None
