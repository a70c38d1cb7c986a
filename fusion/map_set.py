"""A set of maps that grows and shrinks: which pairs to register, what follows from them, and the fused grids.

What follows depends on the maps in the set only: registrations are kept when a map leaves, and used again when it
comes back, but never otherwise. So a map that is added and removed leaves no trace in any group or cell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment
from fusion.certainty import CertaintyGrid, Contribution, fuse
from fusion.consistency import ConsistencyRule
from fusion.identity import reference_rank
from fusion.map_graph import MapEdge, MapGroup, Structure, connect
from fusion.resampling import known_corners
from fusion.retrieval import MapSignature, MapsTogether, RetrievalRule, chosen_pairs, resemblance, signature
from mapping import se2
from mapping.grid import FREE_LOG_ODDS, OccupancyGrid

FloatArray = NDArray[np.float64]
Pair = tuple[str, str]
_OVERLAP_POINTS, _OVERLAP_M2 = 1500, 15.0


@dataclass(frozen=True, slots=True, eq=False)
class MapSet:
    """Maps by name, in the order of `reference_rank`, and the registrations of pairs of them, also of maps that left.

    Every map must have a known cell. The first map of a pair is the one that comes first.
    """

    maps: Mapping[str, OccupancyGrid] = field(default_factory=dict)
    alignments: Mapping[Pair, Alignment] = field(default_factory=dict)
    signatures: Mapping[str, MapSignature] = field(default_factory=dict)
    alike: Mapping[Pair, float] = field(default_factory=dict)
    retrieval: RetrievalRule = RetrievalRule()
    consistency: ConsistencyRule = ConsistencyRule()

    def added(self, maps: Mapping[str, OccupancyGrid]) -> MapSet:
        """Return the set with more maps; raises ValueError for a name that is there already."""
        twice = sorted(set(maps) & set(self.maps))
        if twice:
            raise ValueError(f"{twice[0]}: is in the set already")
        everything = {**self.maps, **maps}
        return replace(self, maps={name: everything[name] for name in in_order(everything)})._compared()

    def removed(self, name: str) -> MapSet:
        """Return the set without a map; raises KeyError for an unknown name."""
        others = dict(self.maps)
        del others[name]
        return replace(self, maps=others)

    def forgetful(self) -> MapSet:
        """Return the set without what it knows of maps that left it: where maps come and go for hours, that grows."""
        return replace(
            self,
            alignments={pair: each for pair, each in self.alignments.items() if self.maps.keys() >= {*pair}},
            signatures={name: each for name, each in self.signatures.items() if name in self.maps},
            alike={pair: each for pair, each in self.alike.items() if self.maps.keys() >= {*pair}},
        )

    def registered(self, alignments: Mapping[Pair, Alignment]) -> MapSet:
        """Return the set with more registrations, of pairs as `missing` names them."""
        return replace(self, alignments={**self.alignments, **alignments})

    def pairs(self) -> list[Pair]:
        """Return the pairs whose registrations count, among them those that are missing yet."""
        verdicts = {pair: alignment.accepted for pair, alignment in self.alignments.items()}
        return chosen_pairs(list(self.maps), self.alike, verdicts, self._grouped, self.retrieval)

    def missing(self) -> list[Pair]:
        """Return the pairs to register next; when they are, there may be more. The most promising ones come first."""
        missing = [pair for pair in self.pairs() if pair not in self.alignments]
        return sorted(missing, key=lambda pair: -self.alike.get(pair, 0.0))

    def structure(self, titles: Mapping[str, str] | None = None) -> Structure:
        """Return the groups, the poses in them, and the pairs that were withdrawn; titles: of maps, for the reasons."""
        return self._connected((pair for pair in self.pairs() if pair in self.alignments), titles)

    def fused(self, group: MapGroup) -> CertaintyGrid:
        """Return the evidence of a group in its frame."""
        return fuse({name: Contribution(self.maps[name], each.T_group_map) for name, each in group.maps.items()})

    def _connected(self, pairs: Iterable[Pair], titles: Mapping[str, str] | None = None) -> Structure:
        edges = []
        for a, b in pairs:
            found = self.alignments[a, b]
            if found.accepted and found.T_a_b is not None:
                covariance = np.zeros((3, 3)) if found.covariance is None else found.covariance
                edges.append(MapEdge(a, b, found.T_a_b, covariance, found.probability or 0.5))
        return connect({name: middle_of(grid) for name, grid in self.maps.items()}, edges, self.consistency, titles)

    def _grouped(self, accepted: Iterable[Pair]) -> Iterable[MapsTogether]:
        """Yield the groups that follow from accepted pairs."""
        for group in self._connected(accepted).groups:
            samples = {name: _free_sample(self.maps[name]) for name in group.maps}
            overlapping = []
            for a, b in itertools.combinations(group.maps, 2):
                points, area_m2 = samples[b]
                T_a_b = se2.between(group.maps[a].T_group_map, group.maps[b].T_group_map)
                if _share_free(self.maps[a], se2.transform_points(T_a_b, points)) * area_m2 >= _OVERLAP_M2:
                    overlapping.append((a, b))
            yield MapsTogether(list(group.maps), overlapping)

    def _compared(self) -> MapSet:
        """Return the set with what retrieval needs to know, if it is large enough to need any."""
        if len(self.maps) <= self.retrieval.all_pairs:
            return self
        new = {name: signature(grid) for name, grid in self.maps.items() if name not in self.signatures}
        signatures = {**self.signatures, **new}
        alike = {
            (a, b): resemblance(signatures[a], signatures[b])
            for a, b in itertools.combinations(self.maps, 2)
            if (a, b) not in self.alike
        }
        return replace(self, signatures=signatures, alike={**self.alike, **alike})


def in_order(maps: Mapping[str, OccupancyGrid]) -> list[str]:
    """Return the names of maps in the order of `reference_rank`, equals by their names."""
    ranks = {name: (*reference_rank(grid), name) for name, grid in maps.items()}
    return sorted(maps, key=ranks.__getitem__)


def middle_of(grid: OccupancyGrid) -> FloatArray:
    """Return the middle (2,) in the map frame of the box around the known cells, of which there must be one."""
    return np.asarray(known_corners(grid).mean(axis=0))


def _free_sample(grid: OccupancyGrid) -> tuple[FloatArray, float]:
    """Return centres (N, 2) of free cells, spread evenly, and the free area in m^2 (of all)."""
    rows, cols = np.nonzero(grid.free)
    some = np.linspace(0, max(len(rows) - 1, 0), min(len(rows), _OVERLAP_POINTS)).astype(np.intp)
    return grid.cell_centers(rows[some], cols[some]), float(len(rows)) * grid.resolution_m**2


def _share_free(grid: OccupancyGrid, points: FloatArray) -> float:
    """Return the share of points (N, 2) of the map frame that lie on free cells."""
    if len(points) == 0:
        return 0.0
    col, row = np.floor(grid.cell_coordinates(points)).astype(np.int64).T
    inside = (row >= 0) & (col >= 0) & (row < grid.log_odds.shape[0]) & (col < grid.log_odds.shape[1])
    return float(np.count_nonzero(grid.log_odds[row[inside], col[inside]] <= FREE_LOG_ODDS)) / len(points)
