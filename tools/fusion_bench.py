"""`bench fusion`: the registration beside its peers, on the same pairs of maps in the same run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np

from fusion.algorithm3 import THESIS, Algorithm3Settings, register_by_features
from fusion.alignment import Alignment
from fusion.evaluation import error_at_points
from fusion.registration import register
from fusion.verification import AcceptanceRule
from mapping.grid import OccupancyGrid
from tools.errors import UsageError
from tools.pair_files import MapPair, load_grids, read_pairs
from tools.processes import in_own_process, memory, reset_peak
from tools.registration_peers import PeerPose, register_as_m_explore, register_by_spectra
from tools.results import FloatArray, Report

GROUPS = ("low", "mid", "high", "resolution", "camera", "warped")
WALLS = MappingProxyType({"under 3 m": 3.0, "3-8 m": 8.0, "8-20 m": 20.0, "over 20 m": np.inf})  # upper limits
_WRONG_SHARE = 0.25
_WORKING = Algorithm3Settings(0.5, 0.8, 3.0, 5000, AcceptanceRule(10, 0.95))


@dataclass(frozen=True, slots=True)
class Method:
    """One way to register two maps, and in a line what it is."""

    note: str
    register: Callable[[OccupancyGrid, OccupancyGrid, int], PeerPose]


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What a method made of one pair: right is False for every pose of a wrong pair; merges None without verdict."""

    pair: MapPair
    T_a_b: FloatArray | None
    right: bool
    merges: bool | None
    confidence: float | None
    cpu_s: float


@dataclass(frozen=True, slots=True, eq=False)
class MethodResult:
    """A method's outcomes in the order of the pairs, and the peak memory of its process in MB (1e6 bytes)."""

    name: str
    outcomes: tuple[Outcome, ...]
    peak_mb: float


def _own_default(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> PeerPose:
    return _verdict(register(a, b, seed=seed))


def _thesis(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> PeerPose:
    return _verdict(register_by_features(a, b, _WORKING, seed))


def _thesis_literal(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> PeerPose:
    return _verdict(register_by_features(a, b, THESIS, seed))


def _verdict(alignment: Alignment) -> PeerPose:
    confidence = alignment.acceptance if alignment.probability is None else alignment.probability
    return PeerPose(alignment.T_a_b, alignment.accepted, confidence)


def _orb(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> PeerPose:
    return register_as_m_explore(a, b, "orb", seed)


def _akaze(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> PeerPose:
    return register_as_m_explore(a, b, "akaze", seed)


def _spectra(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> PeerPose:  # noqa: ARG001 - nothing in it is random
    return register_by_spectra(a, b)


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "mapfuse-robot": Method("this project's default", _own_default),
        "thesis": Method("Algorithm 3 as written here: alpha 0.5, ratio 0.8, 3 px, 5000 trials", _thesis),
        "thesis, literal": Method("the same with the thesis's own numbers: 0.99, 0.6, 1.5 px, 1000", _thesis_literal),
        "m-explore ORB": Method("ROS package m-explore, imitated with OpenCV's parts; merges over 1", _orb),
        "m-explore AKAZE": Method("the same with its default features", _akaze),
        "Fourier-Mellin": Method("phase correlation of spectra, then of maps; has no verdict", _spectra),
    }
)


def compare_methods(
    folder: Path, count: int, names: Sequence[str] | None, seed: int, on_progress: Callable[[str], None]
) -> Report:
    """Register a sample of a folder's pair list by the named methods, or all, each in a process of its own.

    The report holds a summary for each method, and a row for each pair. Raises UsageError for an unknown name,
    ToolError and MapFileError for what cannot be read.
    """
    chosen = list(dict.fromkeys(names or METHODS))
    for name in chosen:
        if name not in METHODS:
            raise UsageError(f"--method {name!r}: there is none of that name; choose from {', '.join(METHODS)}")
    listed = read_pairs(folder)
    sampled = sample_pairs(listed, count, seed)
    results = []
    for name in chosen:
        on_progress(f"{name}: {len(sampled)} pairs")
        results.append(in_own_process(bench_method, name, sampled, seed))
    return {
        "pairs": str(folder),
        "sampled": len(sampled),
        "of": len(listed),
        "seed": seed,
        "methods": [summarise(result) for result in results],
        "rows": {result.name: [pair_row(outcome) for outcome in result.outcomes] for result in results},
    }


def sample_pairs(pairs: Sequence[MapPair], count: int, seed: int) -> list[MapPair]:
    """Return up to `count` of the pairs, in their order, each kind and band in its proportion.

    A quarter are wrong pairs, where there are enough of both: what is compared first is how often a pose is found.
    """
    wrong = [number for number, pair in enumerate(pairs) if pair.truth is None]
    true = [number for number, pair in enumerate(pairs) if pair.truth is not None]
    of_wrong = min(len(wrong), max(round(_WRONG_SHARE * count), count - len(true)))
    random = np.random.default_rng(seed)
    drawn = _evenly(pairs, true, count - of_wrong, random) + _evenly(pairs, wrong, of_wrong, random)
    return [pairs[number] for number in sorted(drawn)]


def _evenly(pairs: Sequence[MapPair], numbers: Sequence[int], count: int, random: np.random.Generator) -> list[int]:
    """Return up to `count` of the numbers, drawn at random so that each sort of pair has its share."""
    shuffled = random.permutation(np.asarray(numbers, dtype=np.intp)).tolist()
    by_sort = sorted(shuffled, key=lambda number: _sort(pairs[number]))
    kept = min(count, len(numbers))
    return [by_sort[place * len(numbers) // kept] for place in range(kept)]


def _sort(pair: MapPair) -> tuple[str, str, bool]:
    return pair.kind, pair.band or "", pair.building_a == pair.building_b


def bench_method(name: str, pairs: Sequence[MapPair], seed: int) -> MethodResult:
    """Register every pair by one method. For a process of its own; raises MapFileError where a map is unreadable.

    CPU time is this process's, one thread for OpenCV, without reading the maps; what numba compiles, it compiles before
    with the first pair.
    """
    cv2.setNumThreads(1)
    method = METHODS[name]
    method.register(*load_grids(pairs[0]), seed)
    reset_peak()
    outcomes = tuple(_outcome(method, pair, seed) for pair in pairs)
    return MethodResult(name, outcomes, memory().peak_mb)


def _outcome(method: Method, pair: MapPair, seed: int) -> Outcome:
    a, b = load_grids(pair)
    began = time.process_time()
    found = method.register(a, b, seed)
    cpu_s = time.process_time() - began
    return Outcome(pair, found.T_a_b, is_right(pair, found.T_a_b), found.merges, found.confidence, cpu_s)


def is_right(pair: MapPair, T_a_b: FloatArray | None) -> bool:
    """Tell whether a pose (3,) meets the pair's truth; never where there is no truth or no pose."""
    truth = pair.truth
    if truth is None or T_a_b is None:
        return False
    error = error_at_points(truth.points_a, truth.points_b, T_a_b, truth.T_a_b)
    return error.rms_m <= truth.right_m and error.rotation_deg <= truth.right_deg


def summarise(result: MethodResult) -> Report:
    """Return the counts of one method: aligned by group and by common wall, merged where it has a verdict, and costs.

    aligned: the best pose is right, whatever the verdict. merged: what the method's own verdict lets through.
    """
    true = [outcome for outcome in result.outcomes if outcome.pair.truth is not None]
    wrong = [outcome for outcome in result.outcomes if outcome.pair.truth is None]
    seconds = [outcome.cpu_s for outcome in result.outcomes]
    groups = {name: [outcome for outcome in true if _group(outcome.pair) == name] for name in GROUPS}
    walls = {name: [outcome for outcome in true if _wall(outcome.pair) == name] for name in WALLS}
    return {
        "name": result.name,
        "note": METHODS[result.name].note,
        "aligned": {name: _share(group) for name, group in {**groups, "all": true}.items()},
        "aligned_by_common_wall": {name: _share(group) for name, group in walls.items()},
        "merged": _merged(true, wrong),
        "cpu_s": {
            "median": round(float(np.median(seconds)), 4),
            "p95": round(float(np.percentile(seconds, 95)), 4),
        },
        "peak_mb": round(result.peak_mb, 1),
    }


def _merged(true: Sequence[Outcome], wrong: Sequence[Outcome]) -> Report | None:
    """Return what the verdict let through; None for a method without one."""
    if all(outcome.merges is None for outcome in (*true, *wrong)):
        return None
    same = [outcome for outcome in wrong if outcome.pair.building_a == outcome.pair.building_b]
    other = [outcome for outcome in wrong if outcome.pair.building_a != outcome.pair.building_b]
    return {
        "right": sum(bool(outcome.merges) and outcome.right for outcome in true),
        "wrong": sum(bool(outcome.merges) and not outcome.right for outcome in true),
        "of_pairs": len(true),
        "false_same_building": {"merged": sum(bool(outcome.merges) for outcome in same), "pairs": len(same)},
        "false_other_building": {"merged": sum(bool(outcome.merges) for outcome in other), "pairs": len(other)},
    }


def pair_row(outcome: Outcome) -> Report:
    """Return one outcome for JSON."""
    return {
        "pair": outcome.pair.name,
        "same_place": outcome.pair.truth is not None,
        "T_a_b": None if outcome.T_a_b is None else np.asarray(outcome.T_a_b).tolist(),
        "right": outcome.right,
        "merges": outcome.merges,
        "confidence": None if outcome.confidence is None else round(outcome.confidence, 4),
        "cpu_s": round(outcome.cpu_s, 4),
    }


def _share(outcomes: Sequence[Outcome]) -> Report:
    return {"right": sum(outcome.right for outcome in outcomes), "pairs": len(outcomes)}


def _group(pair: MapPair) -> str | None:
    return pair.band if pair.kind == "lidar" else pair.kind


def _wall(pair: MapPair) -> str | None:
    if pair.common_wall_m is None:
        return None
    return next(name for name, limit_m in WALLS.items() if pair.common_wall_m < limit_m)
