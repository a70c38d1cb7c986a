"""Files of planning problems: for each of some maps, poses to plan between, and the length that is compared with."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.wording import fault_in
from tools.errors import ToolError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TimedProblem:
    """Poses (3,) in the map frame, and the length in m that a path is compared with."""

    start: FloatArray
    goal: FloatArray
    ref_m: float


def read_problems(file: Path) -> dict[str, list[TimedProblem]]:
    """Read {map: [{start, goal, ref}, ...]}, at least one a map; raises ToolError."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        problems = {
            name: [
                TimedProblem(_finite(p["start"], 3), _finite(p["goal"], 3), float(_finite([p["ref"]], 1)[0]))
                for p in listed
            ]
            for name, listed in content.items()
        }
        if not problems or not all(problems.values()):
            raise ValueError("a map without problems, or no map")
        for name in problems:
            map_beside(file, name)  # refuses what is no name of a file
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ToolError(
            f"{file}: not a file of planning problems ({fault_in(error)}): expected "
            "{map: [{start: [x, y, yaw], goal: [x, y, yaw], ref: m}, ...]}"
        ) from error
    return problems


def map_beside(file: Path, name: str) -> Path:
    """Return the map file that a file of problems means by a name; raises ValueError where it can be none."""
    return file.with_name(f"{name}.yaml")


def _finite(values: object, count: int) -> FloatArray:
    """Return so many numbers; raises ValueError and TypeError for anything else."""
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f"{values} where {count} finite number{'s' if count > 1 else ''} should be")
    return numbers
