"""Pair lists: map files in twos, and for those of one place the true pose of the second in the frame of the first."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.wording import fault_in
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.errors import ToolError
from tools.json_values import number_or_none, relative_path
from tools.results import writing_to

FloatArray = NDArray[np.float64]
LIST_NAME = "pairs.json"
KINDS = ("lidar", "resolution", "camera", "bent", "changed", "warped")
BANDS = ("low", "mid", "high")
RIGHT_M, RIGHT_DEG = 0.5, 3.0
_FORMAT, _VERSION = "mapfuse-pairs", 1


@dataclass(frozen=True, slots=True, eq=False)
class PairTruth:
    """The true pose (3,) of map b's frame in map a's, points (N, 2) in m known in both, and what counts as right.

    An estimate is right when it brings points_b within right_m (rms) of points_a, and turns within right_deg.
    """

    T_a_b: FloatArray
    points_a: FloatArray
    points_b: FloatArray
    right_m: float = RIGHT_M
    right_deg: float = RIGHT_DEG


@dataclass(frozen=True, slots=True, eq=False)
class MapPair:
    """Two map files; truth is None for a wrong pair: two places, be it of one building or of two.

    kind: lidar (one resolution), resolution (two), camera (b seen by a narrow sensor), bent (both deformed by random
    fields), changed (bent, and things moved in each) or warped (independent maps whose walls bend). band and overlap:
    of the common free space, in the smaller map's; common_wall_m: seen in both.
    """

    name: str
    a: Path
    b: Path
    building_a: str
    building_b: str
    kind: str
    band: str | None = None
    overlap: float | None = None
    common_wall_m: float | None = None
    truth: PairTruth | None = None


def read_pairs(folder: Path) -> list[MapPair]:
    """Read the list of a folder; map paths are those of the list, below the folder. Raises ToolError."""
    path = folder / LIST_NAME
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = error.strerror or error
        raise ToolError(f"{path}: {reason}: name a folder that `mapfuse-robot pairs` wrote") from error
    except ValueError as error:
        raise ToolError(
            f"{path}: not JSON ({fault_in(error)}): name a folder that `mapfuse-robot pairs` wrote"
        ) from error
    if not isinstance(content, dict) or content.get("format") != _FORMAT or content.get("version") != _VERSION:
        raise ToolError(f"{path}: not a pair list: expected format {_FORMAT}, version {_VERSION}")
    pairs = content.get("pairs")
    if not isinstance(pairs, list) or not pairs:
        raise ToolError(f"{path}: holds no pairs: make some with `mapfuse-robot pairs`")
    read = []
    for number, entry in enumerate(pairs):
        try:
            read.append(_pair_of(entry, folder))
        except (KeyError, TypeError, ValueError) as error:
            raise ToolError(f"{path}: pair {number} is not whole: {fault_in(error)}: make the list anew") from error
    return read


def joined_pairs(folders: Sequence[Path]) -> list[MapPair]:
    """Read several lists as one; a name that another list has too gets its folder's before it. Raises ToolError."""
    lists = [read_pairs(folder) for folder in folders]
    uses = Counter(pair.name for pairs in lists for pair in pairs)
    joined = [
        pair if uses[pair.name] == 1 else replace(pair, name=f"{folder.resolve().name}-{pair.name}")
        for folder, pairs in zip(folders, lists, strict=True)
        for pair in pairs
    ]
    twice = [name for name, count in Counter(pair.name for pair in joined).items() if count > 1]
    if twice:
        raise ToolError(f"{twice[0]}: the name of two pairs: name each folder once, and folders by different names")
    return joined


def write_pairs(folder: Path, pairs: Sequence[MapPair], origin: str) -> None:
    """Write the list into the folder that holds the maps, whole or not at all; origin: where the maps are from.

    Raises ToolError where the file cannot be written.
    """
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "origin": origin,
        "pairs": [_entry_of(pair, folder) for pair in pairs],
    }
    path = folder / LIST_NAME
    partial = path.with_name(f"{path.name}.part")
    with writing_to(path):
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        partial.replace(path)


def load_grids(pair: MapPair) -> tuple[OccupancyGrid, OccupancyGrid]:
    """Read the two maps of a pair; raises MapFileError."""
    return read_map(pair.a), read_map(pair.b)


def _pair_of(entry: dict[str, Any], folder: Path) -> MapPair:
    kind, band, truth = entry["kind"], entry.get("band"), entry["truth"]
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r}, expected one of {', '.join(KINDS)}")
    if band is not None and band not in BANDS:
        raise ValueError(f"band {band!r}, expected one of {', '.join(BANDS)} or null")
    return MapPair(
        name=str(entry["name"]),
        a=folder / entry["a"],
        b=folder / entry["b"],
        building_a=str(entry["building_a"]),
        building_b=str(entry["building_b"]),
        kind=kind,
        band=band,
        overlap=number_or_none(entry.get("overlap")),
        common_wall_m=number_or_none(entry.get("common_wall_m")),
        truth=None if truth is None else _truth_of(truth),
    )


def _truth_of(entry: dict[str, Any]) -> PairTruth:
    T_a_b, points_a, points_b = (np.array(entry[key], dtype=np.float64) for key in ("T_a_b", "points_a", "points_b"))
    if T_a_b.shape != (3,) or points_a.ndim != 2 or points_a.shape[1:] != (2,) or points_a.shape != points_b.shape:
        raise ValueError(
            f"T_a_b {T_a_b.shape}, points_a {points_a.shape}, points_b {points_b.shape}, expected (3,), (N, 2), (N, 2)"
        )
    right_m, right_deg = float(entry["right_m"]), float(entry["right_deg"])
    if not all(np.isfinite(values).all() for values in (T_a_b, points_a, points_b, right_m, right_deg)):
        raise ValueError("not finite")
    return PairTruth(T_a_b, points_a, points_b, right_m, right_deg)


def _entry_of(pair: MapPair, folder: Path) -> dict[str, Any]:
    truth = pair.truth
    return {
        "name": pair.name,
        "a": relative_path(pair.a, folder),
        "b": relative_path(pair.b, folder),
        "building_a": pair.building_a,
        "building_b": pair.building_b,
        "kind": pair.kind,
        "band": pair.band,
        "overlap": None if pair.overlap is None else round(pair.overlap, 4),
        "common_wall_m": None if pair.common_wall_m is None else round(pair.common_wall_m, 2),
        "truth": None
        if truth is None
        else {
            "T_a_b": truth.T_a_b.tolist(),
            "points_a": np.round(truth.points_a, 4).tolist(),
            "points_b": np.round(truth.points_b, 4).tolist(),
            "right_m": round(truth.right_m, 4),
            "right_deg": truth.right_deg,
        },
    }
