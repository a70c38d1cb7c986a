"""Where each pair's maps could lie on each other, with the evidence, and which of these places are right."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.wording import fault_in
from fusion.evaluation import error_at_points
from fusion.evidence import TRENDS, different_places, judged_places
from fusion.identity import precedes
from fusion.survey import survey
from mapping import se2
from tools.errors import ToolError
from tools.pair_files import LIST_NAME, MapPair, PairTruth, load_grids, read_pairs
from tools.processes import in_processes
from tools.results import writing_to

FloatArray = NDArray[np.float64]
_SAVED_EACH = 100  # pairs: what was found until then survives the end of the process


@dataclass(frozen=True, slots=True, eq=False)
class HypothesisPool:
    """The K hypotheses of one pair; key: the pair's name after its list's, unlike any other pair's.

    true: there is a right pose; features (K, F) in the order of TRENDS; right (K,): which hypotheses are; different
    (K, K): which are two places. K is 0 where the maps cannot be aligned at all.
    """

    key: str
    buildings: tuple[str, str]
    true: bool
    features: FloatArray
    right: NDArray[np.bool_]
    different: NDArray[np.bool_]


def keyed_pairs(folder: Path) -> dict[str, MapPair]:
    """Read a list and return its pairs by key: the folder's name, a hash of the list, and the pair's name."""
    pairs = read_pairs(folder)
    content = hashlib.sha256((folder / LIST_NAME).read_bytes()).hexdigest()[:12]
    keyed = {f"{folder.resolve().name}:{content}:{pair.name}": pair for pair in pairs}
    if len(keyed) < len(pairs):
        raise ToolError(f"{folder}: two pairs of the list have one name: make the list anew")
    return keyed


def pools_of(
    pairs: dict[str, MapPair], seed: int, jobs: int, cache: Path | None, on_progress: Callable[[str], None]
) -> list[HypothesisPool]:
    """Return the pool of each pair, in their order; those in the cache file are taken from there, new ones put there.

    seed: of the feature matches; jobs: processes. Raises MapFileError, and ToolError for a cache of other evidence or
    of another seed.
    """
    found = {} if cache is None or not cache.exists() else read_pools(cache, seed)
    missing = {key: pair for key, pair in pairs.items() if key not in found}
    on_progress(f"{len(pairs)} pairs, {len(pairs) - len(missing)} of them in the cache")
    computed = in_processes(
        partial(pool_of, seed=seed), list(missing), list(missing.values()), jobs=jobs, first=(cv2.setNumThreads, (1,))
    )
    for new, pool in enumerate(computed, start=1):
        found[pool.key] = pool
        if new % _SAVED_EACH == 0 or new == len(missing):
            on_progress(f"hypotheses of {new} of {len(missing)} pairs")
            if cache is not None:
                write_pools(cache, list(found.values()), seed)
    return [found[key] for key in pairs]


def pool_of(key: str, pair: MapPair, seed: int) -> HypothesisPool:
    """Return the hypotheses of a pair as the registration makes them, each judged by the pair's truth."""
    a, b = load_grids(pair)
    exchanged = precedes(b, a)
    first, second = (survey(grid) for grid in ((b, a) if exchanged else (a, b)))
    buildings, true = (pair.building_a, pair.building_b), pair.truth is not None
    if any(each.free_m2 == 0.0 or each.wall_m == 0.0 for each in (first, second)):
        return HypothesisPool(
            key, buildings, true, np.empty((0, len(TRENDS))), np.empty(0, np.bool_), np.empty((0, 0), np.bool_)
        )
    pool, evidence = judged_places(first, second, seed)
    poses = se2.compose(se2.compose(first.walls.T_map_grid, pool.poses), se2.inverse(second.walls.T_map_grid))
    right = _right(pair.truth, se2.inverse(poses) if exchanged else poses)
    table = np.column_stack([evidence.features[name] for name in TRENDS])
    return HypothesisPool(key, buildings, true, table, right, different_places(pool.poses, second))


def read_pools(path: Path, seed: int) -> dict[str, HypothesisPool]:
    """Read a cache of pools by key; raises ToolError for one of other evidence, of another seed, or damaged."""
    try:
        with np.load(path) as stored:
            held = int(stored["seed"])
            if stored["names"].tolist() != list(TRENDS) or held != seed:
                raise ToolError(
                    f"{path}: of other evidence, or of seed {held} instead of {seed}: delete it, or name another"
                )
            sizes = stored["sizes"]
            rows, squares = np.cumsum(sizes)[:-1], np.cumsum(sizes**2)[:-1]
            parts = zip(
                stored["keys"].tolist(),
                stored["buildings"].tolist(),
                stored["true"].tolist(),
                np.split(stored["features"], rows),
                np.split(stored["right"], rows),
                np.split(stored["different"], squares),
                sizes.tolist(),
                strict=True,
            )
            return {
                key: HypothesisPool(key, (building[0], building[1]), true, features, right, square.reshape(size, size))
                for key, building, true, features, right, square, size in parts
            }
    except (OSError, EOFError, ValueError, KeyError) as error:
        raise ToolError(f"{path}: no cache of pools ({fault_in(error)}): delete it, or name another") from error


def write_pools(path: Path, pools: Sequence[HypothesisPool], seed: int) -> None:
    """Write a cache of pools, whole or not at all."""
    partial_path = path.with_name(f"{path.name}.part")
    with writing_to(path), partial_path.open("wb") as file:
        np.savez_compressed(
            file,
            names=np.array(list(TRENDS)),
            seed=np.array(seed),
            keys=np.array([pool.key for pool in pools]),
            buildings=np.array([pool.buildings for pool in pools]),
            true=np.array([pool.true for pool in pools]),
            sizes=np.array([len(pool.right) for pool in pools]),
            features=np.vstack([pool.features for pool in pools]),
            right=np.concatenate([pool.right for pool in pools]),
            different=np.concatenate([pool.different.reshape(-1) for pool in pools]),
        )
    with writing_to(path):
        partial_path.replace(path)


def _right(truth: PairTruth | None, poses: FloatArray) -> NDArray[np.bool_]:
    """Return which poses (K, 3) of map b in map a are right."""
    if truth is None:
        return np.zeros(len(poses), np.bool_)
    errors = [error_at_points(truth.points_a, truth.points_b, pose, truth.T_a_b) for pose in poses]
    return np.array([each.rms_m <= truth.right_m and each.rotation_deg <= truth.right_deg for each in errors], np.bool_)
