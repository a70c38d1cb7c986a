"""What a trajectory is scored against: true relations or a true trajectory, told apart by what the file holds.

Both have eight numbers a line. In TUM text the last four are a unit quaternion; in a relation they are a height and
three angles.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mapping.errors import MappingError, TruthError, unreadable
from mapping.relations import Relations, read_relations
from mapping.trajectory import Trajectory, read_tum

_LINES_LOOKED_AT = 200
_NORM_SLACK = 0.02  # of quaternions with three or four digits
_LEAST_SHARE = 0.9


def read_truth(path: Path) -> Relations | Trajectory:
    """Read a file of relations or a trajectory in TUM text; raises a MappingError of one line."""
    rows = _first_rows(path)
    if not len(rows):
        raise TruthError(
            f"{path}: neither relations (stamp1 stamp2 dx dy dz roll pitch yaw) nor a trajectory (t x y z qx qy qz qw)"
        )
    norms = np.sqrt((rows[:, 4:] ** 2).sum(axis=1))
    is_trajectory = (np.abs(norms - 1.0) < _NORM_SLACK).mean() >= _LEAST_SHARE
    return read_tum(path) if is_trajectory else read_relations(path)


def _first_rows(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the first lines that hold eight numbers, (N, 8); raises MappingError."""
    rows: list[list[float]] = []
    try:
        with path.open(encoding="utf-8") as lines:
            for line in lines:
                fields = line.split()
                if len(fields) != 8 or fields[0].startswith("#"):
                    continue
                try:
                    rows.append([float(field) for field in fields])
                except ValueError:
                    continue  # the reader says which line
                if len(rows) == _LINES_LOOKED_AT:
                    break
    except (OSError, UnicodeDecodeError) as error:
        raise MappingError(f"{path}: cannot read the truth: {unreadable(error)}") from error
    return np.array(rows, dtype=np.float64).reshape(-1, 8)
