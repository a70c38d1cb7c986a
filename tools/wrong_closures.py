"""Wrong loop closures, as look-alike places would give them: to measure that none of them bends a map.

A pure function of poses, real closures and a seed. The wrong ones claim the certainty of real ones, so that nothing but
their contradiction to the rest of the graph can tell them apart.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.loop_closure import Closure
from tools.errors import ToolError

FloatArray = NDArray[np.float64]

_FAR_SHARE = 0.2  # of the map's longer side: so far apart are two places that look alike, at the least
_ALIKE_M, _ALIKE_RAD = 0.5, 0.3  # standard deviations of a wrong closure's relative pose: a small one, as of a revisit
_TRIALS = 10_000


def random_closures(poses: FloatArray, real: tuple[Closure, ...], count: int, seed: int) -> tuple[Closure, ...]:
    """Return `count` closures between keyframes that are far apart in the map with poses (K, 3), each for itself.

    real: the drive's own closures, whose information and agreement the wrong ones bear. Raises ToolError where there
    is no real one, or where no two keyframes are far apart.
    """
    random = np.random.default_rng(seed)
    return tuple(
        _closure(*_far_apart(poses, 1, random), _small_pose(random), _any_of(real, random)) for _ in range(count)
    )


def agreeing_closures(poses: FloatArray, real: tuple[Closure, ...], count: int, seed: int) -> tuple[Closure, ...]:
    """Return `count` closures that agree with each other: two stretches of the drive, tied by one wrong transform.

    Arguments and errors as of `random_closures`.
    """
    random = np.random.default_rng(seed)
    first, second = _far_apart(poses, count, random)
    wrong_place = se2.compose(poses[first], _small_pose(random))  # where the second stretch is said to begin
    moved = se2.compose(wrong_place, se2.between(poses[second], poses[second : second + count]))
    claimed = se2.between(poses[first : first + count], moved)
    return tuple(
        _closure(first + step, second + step, pose, _any_of(real, random)) for step, pose in enumerate(claimed)
    )


def _far_apart(poses: FloatArray, length: int, random: np.random.Generator) -> tuple[int, int]:
    """Return the first keyframes, in the drive's order, of two stretches of a length whose places are far apart."""
    far_m = _FAR_SHARE * float(np.ptp(poses[:, :2], axis=0).max())
    last = len(poses) - length
    for _ in range(_TRIALS if last > 0 else 0):
        first, second = sorted(random.integers(0, last + 1, 2).tolist())
        apart_m = np.hypot(*(poses[first : first + length, :2] - poses[second : second + length, :2]).T)
        if second - first >= length and apart_m.min() > far_m:
            return first, second
    raise ToolError(f"no two stretches of {length} keyframes lie more than {far_m:.1f} m apart: take a longer drive")


def _small_pose(random: np.random.Generator) -> FloatArray:
    return random.normal(0.0, (_ALIKE_M, _ALIKE_M, _ALIKE_RAD))


def _any_of(real: tuple[Closure, ...], random: np.random.Generator) -> Closure:
    if not real:
        raise ToolError("the drive closes no loop: wrong closures have nothing to be like; take one that comes back")
    return real[int(random.integers(len(real)))]


def _closure(first: int, second: int, T_first_second: FloatArray, like: Closure) -> Closure:
    return replace(like, first=first, second=second, T_first_second=T_first_second)
