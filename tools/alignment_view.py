"""What a registration decided, with the figures behind it, in words and numbers for a person."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
VERDICTS = ("accepted", "refused", "ambiguous")


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentView:
    """What the picture tells; None and empty where it is not known.

    verdict: accepted, refused or ambiguous. T_a_b (3,): pose of b's map frame in a's, in m and rad, at the best place;
    covariance (3, 3) of it; alternatives: the next best poses (3,) and their probabilities. acceptance: omega (3.15).
    overlap: share of the smaller map; common_wall_m, conflict_m: metres of wall that both show, or that one denies.
    points_a, points_b (N, 2): matching features, each in its map's frame. score (rows, cols), row 0 at the lowest y:
    the best score of each shift; score_extent_m: its x_min, x_max, y_min, y_max. slide: direction in rad in a's frame
    and metres either way in which the pose is loose. names: of the two maps.
    """

    verdict: str
    reason: str
    T_a_b: FloatArray | None = None
    probability: float | None = None
    covariance: FloatArray | None = None
    acceptance: float = 0.0
    overlap: float = 0.0
    common_wall_m: float | None = None
    conflict_m: float | None = None
    alternatives: tuple[tuple[FloatArray, float], ...] = ()
    points_a: FloatArray | None = None
    points_b: FloatArray | None = None
    score: FloatArray | None = None
    score_extent_m: tuple[float, float, float, float] | None = None
    slide: tuple[float, float] | None = None
    names: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        if self.verdict.lower() not in VERDICTS:
            raise ValueError(f"verdict {self.verdict!r}, expected one of {', '.join(VERDICTS)}")
        for pose in (*([] if self.T_a_b is None else [self.T_a_b]), *(pose for pose, _ in self.alternatives)):
            if np.shape(pose) != (3,) or not np.isfinite(pose).all():
                raise ValueError(f"pose {pose} is not a finite (x, y, yaw)")
        if (self.score is None) != (self.score_extent_m is None):
            raise ValueError("score and score_extent_m belong together: give both or none")
        points_a, points_b = (np.empty((0, 2)) if side is None else side for side in (self.points_a, self.points_b))
        if points_a.shape != points_b.shape:
            raise ValueError(f"points_a {points_a.shape} and points_b {points_b.shape} are no pairs")


def chance_text(view: AlignmentView) -> str:
    """Return how probable the place found is, or the two places; empty where it is not known."""
    if view.probability is None or view.T_a_b is None:
        return ""
    if view.verdict.lower() == "ambiguous" and view.alternatives:
        return f"{percent(view.probability)} or {percent(view.alternatives[0][1])}"
    name = "probability" if view.verdict.lower() == "accepted" else "best guess:"
    return f"{name} {percent(view.probability)}"


def headline(view: AlignmentView) -> str:
    """Return in one sentence what the verdict means."""
    if view.T_a_b is None:
        return "Not merged: no place for map B in map A was found."
    if view.verdict.lower() == "accepted":
        return f"Map B lies in map A at {pose_text(view.T_a_b)}."
    if view.verdict.lower() == "ambiguous":
        return "Not merged: map B fits into map A at more than one place."
    return "Not merged: the best guess, shown below, is not to be trusted."


def figures(view: AlignmentView, T_a_b: FloatArray) -> list[tuple[str, str]]:
    """Return the figures behind the verdict: what, and how much."""
    sigmas: list[float | None] = [None, None, None]
    if view.covariance is not None:
        sigmas = np.sqrt(np.maximum(np.diag(view.covariance), 0.0)).tolist()
    rows = []
    what = "B in A" if view.verdict.lower() == "accepted" else "best guess"
    units = (("x", 1.0, "m"), ("y", 1.0, "m"), ("turn", math.degrees(1.0), "deg"))
    for (name, factor, unit), value, sigma in zip(units, T_a_b.tolist(), sigmas, strict=True):
        spread = "" if sigma is None else f" +- {sigma * factor:.3f}"
        rows.append((f"{what}: {name}", f"{value * factor:.3f}{spread} {unit}"))
    rows += [
        ("cells that agree (acceptance index omega)", f"{view.acceptance:.3f}"),
        ("overlap, of the smaller map", percent(view.overlap)),
    ]
    if view.common_wall_m is not None:
        rows.append(("wall seen by both", f"{view.common_wall_m:.1f} m"))
    if view.conflict_m is not None:
        rows.append(("wall in the other's free space", f"{view.conflict_m:.1f} m"))
    if view.points_a is not None:
        rows.append(("matching features", f"{len(view.points_a)}"))
    return rows


def pose_text(pose: FloatArray) -> str:
    """Return a pose (3,) in m and rad as a person reads it."""
    x, y, yaw = pose.tolist()
    return f"x {x:.2f} m, y {y:.2f} m, {math.degrees(yaw):.1f} deg"


def percent(share: float) -> str:
    """Return a share as percent that never rounds to all or nothing."""
    if 0.0 < share < 0.01:
        return "< 1 %"
    if 0.99 < share < 1.0:
        return "> 99 %"
    return f"{share:.0%}".replace("%", " %")
