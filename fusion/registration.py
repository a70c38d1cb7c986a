"""The relative pose of two maps, by the method of choice, and whether to believe it."""

from __future__ import annotations

from typing import Literal

import numpy as np

from fusion.algorithm3 import THESIS, Algorithm3Settings, register_by_features
from fusion.alignment import Alignment
from fusion.identity import content_corner, same_evidence
from fusion.layered import register_layers
from mapping import se2
from mapping.grid import OccupancyGrid

Method = Literal["default", "thesis"]


def register(
    a: OccupancyGrid,
    b: OccupancyGrid,
    method: Method = "default",
    seed: int = 0,
    settings: Algorithm3Settings = THESIS,
) -> Alignment:
    """Find the pose of map b in the frame of map a; exchanging the two gives exactly the inverse.

    settings are those of method "thesis", Algorithm 3; "default" has its own. Two files of one map need no method.
    """
    if same_evidence(a, b):
        T_a_b = se2.compose(content_corner(a), se2.inverse(content_corner(b)))
        return Alignment(
            T_a_b,
            True,
            "the two are the same map, cell by cell",
            None,
            1.0,
            1.0,
            probability=1.0,
            covariance=np.zeros((3, 3)),
        )
    if method == "thesis":
        return register_by_features(a, b, settings, seed)
    return register_layers(a, b, seed=seed)


def warm_up(method: Method = "default") -> None:
    """Load what is compiled, by registering two tiny maps: so that a measured time is that of the registration."""
    random = np.random.default_rng(0)
    cells = np.full((60, 60), -3.0, np.float32)
    cells[[5, 54], 5:55] = cells[5:55, [5, 54]] = 3.0
    maps = []
    for _ in range(2):
        furnished = cells.copy()
        furnished[tuple(random.integers(10, 50, (2, 8)))] = 3.0
        maps.append(OccupancyGrid(furnished, 0.1, np.zeros(3)))
    register(maps[0], maps[1], method)
