"""The relations metric: how well a trajectory keeps the true relative poses between pairs of scans.

Source: Kuemmerle et al., "On measuring the accuracy of SLAM algorithms" (Autonomous Robots 2009). A relations file has
one pair a line: stamp1 stamp2 dx dy dz roll pitch yaw, the pose of the second scan as the first sees it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.errors import RelationsError, unreadable
from mapping.trajectory import StampArray, Trajectory, parse_stamp_ns

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """True relative poses (N, 3) between the instants first_ns (N,) and second_ns (N,)."""

    first_ns: StampArray
    second_ns: StampArray
    poses: FloatArray

    def __len__(self) -> int:
        return len(self.poses)


SHORT_S = 10.0  # relations between closer scans than that tell of the odometry, the others of the loops


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Absolute errors over the relations whose two stamps are in the trajectory; unmatched: those that are not.

    unmatched_share: their share of all. short: the same figures for relations over less than SHORT_S alone, None where
    not one of them is matched.
    """

    relations: int
    unmatched: int
    unmatched_share: float
    mean_m: float
    std_m: float
    median_m: float
    max_m: float
    mean_deg: float
    std_deg: float
    median_deg: float
    max_deg: float
    mean_squared_m2: float
    mean_squared_deg2: float
    short: RelationErrors | None = None


def read_relations(path: Path) -> Relations:
    """Read a relations file; raise RelationsError with the number of a line that does not parse."""
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RelationsError(f"{path}: cannot read the relations: {unreadable(error)}") from error
    first: list[int] = []
    second: list[int] = []
    poses: list[tuple[float, float, float]] = []
    for number, line in enumerate(lines, start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            x, y, _, _, _, yaw = (float(field) for field in fields[2:])
            stamps = parse_stamp_ns(fields[0]), parse_stamp_ns(fields[1])
        except (ValueError, IndexError) as error:
            raise RelationsError(
                f"{path}:{number}: expected 'stamp1 stamp2 dx dy dz roll pitch yaw': {error}"
            ) from error
        first.append(stamps[0])
        second.append(stamps[1])
        poses.append((x, y, yaw))
    if not poses:
        raise RelationsError(f"{path}: no relation in it")
    return Relations(np.array(first, dtype=np.int64), np.array(second, dtype=np.int64), np.array(poses))


def relation_errors(trajectory: Trajectory, relations: Relations) -> RelationErrors:
    """Compare the trajectory's relative poses with the true ones, at exactly their stamps.

    Raises RelationsError if not one relation has both its stamps in the trajectory.
    """
    first, has_first = _index_of(relations.first_ns, trajectory.stamps_ns)
    second, has_second = _index_of(relations.second_ns, trajectory.stamps_ns)
    matched = has_first & has_second
    if not matched.any():
        raise RelationsError("no relation has both its stamps in the trajectory: is it of the same log?")
    estimated = se2.between(trajectory.poses[first], trajectory.poses[second])
    error = se2.between(relations.poses, estimated)
    distance = np.hypot(error[:, 0], error[:, 1])
    turn = np.degrees(np.abs(se2.wrap_angle(error[:, 2])))
    is_short = np.abs(relations.second_ns - relations.first_ns) < round(SHORT_S * 1e9)
    short = _figures(distance[is_short], turn[is_short], matched[is_short]) if (is_short & matched).any() else None
    return replace(_figures(distance, turn, matched), short=short)


def _figures(distance_m: FloatArray, turn_deg: FloatArray, matched: NDArray[np.bool_]) -> RelationErrors:
    """Return the figures of errors (N,), of which only the matched ones mean anything."""
    distance, turn = distance_m[matched], turn_deg[matched]
    return RelationErrors(
        relations=int(matched.sum()),
        unmatched=int((~matched).sum()),
        unmatched_share=float((~matched).mean()),
        mean_m=float(distance.mean()),
        std_m=float(distance.std()),
        median_m=float(np.median(distance)),
        max_m=float(distance.max()),
        mean_deg=float(turn.mean()),
        std_deg=float(turn.std()),
        median_deg=float(np.median(turn)),
        max_deg=float(turn.max()),
        mean_squared_m2=float((distance**2).mean()),
        mean_squared_deg2=float((turn**2).mean()),
    )


def _index_of(wanted_ns: StampArray, stamps_ns: StampArray) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return where in the rising stamps each wanted one is, and whether it is there at all."""
    index = np.clip(np.searchsorted(stamps_ns, wanted_ns), 0, len(stamps_ns) - 1)
    return index, np.asarray(stamps_ns[index] == wanted_ns)
