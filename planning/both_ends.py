"""The search of last resort: from both ends at once, in wide cells first and in narrow ones where those are used up.

Whichever end is the harder to get away from is the one to begin with, and nobody knows which that is. An end from which
no cell is left proves, as far as the cells are narrow, that there is no way: that takes the time that its surroundings
take, not that of the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.first_path import Deadline
from planning.lattice import LatticeSearch, LatticeWidth, Outcome
from planning.pieces import Pieces

FloatArray = NDArray[np.float64]

_WIDTHS = (0.5, 0.2)  # of the car's inradius
_TURN = 400  # poses that one side looks at before it is the other's turn
_MOST = 3_000_000  # poses of both sides: 250 MB


@dataclass(frozen=True, slots=True, eq=False)
class Unreachable:
    """No way was left to try; nearest (3,), local: the pose nearest to the goal that the car can get to."""

    nearest: FloatArray


def search_from_both_ends(costmap: Costmap, ends: FloatArray, deadline: Deadline) -> Pieces | Unreachable | None:
    """Return a free path between local poses (2, 3), that there is none, or None where that is not known in time."""
    reached = ends[:1]
    for share in _WIDTHS:
        width = LatticeWidth.of(costmap, share)
        ahead, back = (LatticeSearch(costmap, ends, width, backwards=side) for side in (False, True))
        outcome = Outcome.open
        while outcome is Outcome.open:
            for search in (ahead, back):
                if deadline.is_over() or ahead.count + back.count > _MOST:
                    return None
                outcome = search.advance(_TURN)
                if outcome is Outcome.found:
                    return search.way()
                if outcome is Outcome.exhausted:
                    break
        reached = np.concatenate([reached, ahead.poses])
    away_m = np.hypot(*(reached[:, :2] - ends[1, :2]).T)
    return Unreachable(reached[int(away_m.argmin())])
