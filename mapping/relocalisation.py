"""Where on a saved map is the robot? From the last metres of driving, without any prior, and never a guess.

The local cloud is searched for on the whole map at every heading (global_search), the best places are
refined below a cell, and each is judged by all points: how many lie on walls, how many in the map's free space, how
many were seen through its walls. A place is believed if the evidence is enough, no other place explains nearly as much,
the walls pin it down in every direction, and a later search finds it again where the odometry says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.global_search import MOST_POINTS_EVERYWHERE, search_everywhere
from mapping.local_cloud import LocalCloud, Sighting
from mapping.map_matching import Fit, covariance_of, refine, structure
from mapping.place_evidence import Evidence, judge
from mapping.reference_map import ReferenceMap

FloatArray = NDArray[np.float64]

_SEARCH_POINTS = min(192, MOST_POINTS_EVERYWHERE)
_REFINE_POINTS = 800
_APART_M, _APART_RAD = 0.5, np.radians(10.0)  # between places that the search tells apart
_SAME_M, _SAME_RAD = 0.3, np.radians(5.0)  # between refined places that are one
_CONTRADICTION = 2.0  # a point against a place weighs as much as two for it


@dataclass(frozen=True, slots=True)
class RelocalisationSettings:
    """When to look, and what makes a place certain; shares are of the points where the map knows something.

    cloud_m: driving whose points are searched for, and short_cloud_m where those do not fit: what was seen may be bent,
    or not all be there any more. range_m: points farther away are left out. try_every_m, try_every_rad: driving between
    searches. least_score, least_share, places: see global_search. min_points: seen (about 0.1 m of wall each).
    min_known: share of all points that lie where the map knows something, least_known: and how many. min_hits: share on
    walls. max_contradiction: share in free space or seen through walls. max_rival: the second-best place's support at
    the most, as a share of the best one's. min_structure: see map_matching.structure. confirm_m: so far apart are the
    searches that must agree, within agree_m and agree_rad, and at least min_new points seen in between must fit as
    well. sure_*: enough at once.
    """

    cloud_m: float = 8.0
    short_cloud_m: float = 3.0
    range_m: float = 12.0
    try_every_m: float = 0.5
    try_every_rad: float = 1.0
    least_score: float = 0.5
    least_share: float = 0.7
    places: int = 8
    min_points: int = 150
    min_known: float = 0.45
    least_known: int = 90
    min_hits: float = 0.7
    max_contradiction: float = 0.2
    max_rival: float = 0.75
    min_structure: float = 0.05
    confirm_m: float = 0.9
    agree_m: float = 0.2
    agree_rad: float = 0.05
    min_new: int = 40
    sure_points: int = 300
    sure_hits: float = 0.9
    sure_contradiction: float = 0.04
    sure_rival: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """The body's pose T_map_base (3,) at stamp_ns with its covariance (3, 3) in m and rad, and T_map_odom (3,).

    score: share of the seen points on walls of the map; reason: what the verdict rests on; by_odometry: it is only what
    the odometry makes of an earlier place.
    """

    stamp_ns: int
    T_map_base: FloatArray
    T_map_odom: FloatArray
    covariance: FloatArray
    score: float
    reason: str
    by_odometry: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A place that was searched for: the refined fit in the grid's frame, and what the points say about it."""

    fit: Fit
    evidence: Evidence

    @property
    def support(self) -> float:
        """Points that speak for the place, less those against it, doubly."""
        return self.evidence.hits - _CONTRADICTION * (self.evidence.astray + self.evidence.through)


class Relocaliser:
    """Takes scans one at a time and says where they were made on the map, once it is certain.

    sensor (2,): the laser's place on the body. `reason` says in words why it is not certain yet.
    """

    def __init__(
        self, reference: ReferenceMap, settings: RelocalisationSettings, sensor: FloatArray = se2.IDENTITY[:2]
    ) -> None:
        self.reason = "no scan yet"
        self.searches = 0
        self._map = reference
        self._settings = settings
        self._cloud = LocalCloud(settings.cloud_m, settings.range_m, sensor)
        self._tried: tuple[float, float] | None = None
        self._candidates: list[tuple[float, FloatArray]] = []  # metres driven, T_grid_odom

    def add(self, stamp_ns: int, points_body: FloatArray, T_odom_base: FloatArray) -> Located | None:
        """Take in a scan (N, 2) in the body frame, made at T_odom_base (3,); return the place if it is certain."""
        if not self._cloud.add(points_body, T_odom_base) or not self._is_time():
            return None
        self._tried = (self._cloud.driven_m, self._cloud.turned_rad)
        return self._search(stamp_ns, np.array(T_odom_base, dtype=np.float64))

    def _is_time(self) -> bool:
        if self._tried is None:
            return True
        driven_m, turned_rad = self._cloud.driven_m - self._tried[0], self._cloud.turned_rad - self._tried[1]
        return driven_m >= self._settings.try_every_m or turned_rad >= self._settings.try_every_rad

    def _search(self, stamp_ns: int, T_odom_base: FloatArray) -> Located | None:
        """Look everywhere once."""
        self.searches += 1
        seen = self._cloud.seen_from(T_odom_base)
        if len(seen.points) < self._settings.min_points:
            self.reason = f"{len(seen.points)} points seen, {self._settings.min_points} are needed"
            return None
        places = find_places(self._map, seen, self._settings)
        if self._cloud.driven_m > self._settings.short_cloud_m and not (places and self._fits(places[0].evidence)):
            seen = self._cloud.seen_from(T_odom_base, self._settings.short_cloud_m)
            places = find_places(self._map, seen, self._settings)
        objection = self._objection(seen, places)
        if objection is not None:
            self.reason = objection
            return None
        best = places[0]
        T_grid_odom = se2.compose(best.fit.pose, se2.inverse(T_odom_base))
        rival = _rival_share(places)
        found_before = self._agreeing(T_grid_odom, T_odom_base)
        self._candidates.append((self._cloud.driven_m, T_grid_odom))
        why = f"{_in_words(best.evidence)}, the next best place {rival:.0%} of its support"
        if self._is_sure(best.evidence, rival):
            return self._located(stamp_ns, best, T_odom_base, why)
        if found_before is None:
            self.reason = f"seen once, to be confirmed {self._settings.confirm_m:g} m on: {why}"
            return None
        new = seen.driven_m > found_before
        fresh = judge(self._map.faces, seen.points[new], seen.facings_rad[new], seen.origins[new], best.fit.pose)
        if fresh.known < self._settings.min_new or not self._fits(fresh):
            self.reason = f"what was seen since does not confirm it: {_in_words(fresh)}"
            return None
        return self._located(stamp_ns, best, T_odom_base, f"found twice; {why}")

    def _objection(self, seen: Sighting, places: list[Place]) -> str | None:
        """Return what speaks against the best place, in words, None if it may be believed."""
        rule = self._settings
        if len(seen.points) < rule.min_points:
            return f"{len(seen.points)} points seen, {rule.min_points} are needed"
        if not places:
            return f"no place on the map explains {rule.least_score:.0%} of what is seen"
        best = places[0].evidence
        if best.known < max(rule.min_known * best.points, rule.least_known):
            return f"only {best.known} of {best.points} points lie where the map knows something"
        if not self._fits(best):
            return f"the best place does not fit: {_in_words(best)}"
        rival = _rival_share(places)
        if rival > rule.max_rival:
            return f"ambiguous: another place has {rival:.0%} of the best one's support"
        firm = structure(places[0].fit)
        if firm < rule.min_structure:
            return f"the walls do not pin the place down in every direction ({firm:.3f}, {rule.min_structure:g} needed)"
        return None

    def _fits(self, evidence: Evidence) -> bool:
        """Whether enough points lie on walls and few enough contradict the map."""
        rule = self._settings
        return evidence.hit_share >= rule.min_hits and evidence.contradiction <= rule.max_contradiction

    def _is_sure(self, evidence: Evidence, rival: float) -> bool:
        """Whether one search is enough."""
        rule = self._settings
        return (
            evidence.known >= rule.sure_points
            and evidence.hit_share >= rule.sure_hits
            and evidence.contradiction <= rule.sure_contradiction
            and rival <= rule.sure_rival
        )

    def _agreeing(self, T_grid_odom: FloatArray, T_odom_base: FloatArray) -> float | None:
        """Return the metres driven at the last earlier search, far enough back, that puts the body here as well."""
        here = se2.compose(T_grid_odom, T_odom_base)
        for driven_m, earlier in reversed(self._candidates):
            if self._cloud.driven_m - driven_m < self._settings.confirm_m:
                continue
            apart = se2.between(se2.compose(earlier, T_odom_base), here)
            near = np.hypot(apart[0], apart[1]) <= self._settings.agree_m
            if near and abs(apart[2]) <= self._settings.agree_rad:
                return driven_m
        return None

    def _located(self, stamp_ns: int, place: Place, T_odom_base: FloatArray, reason: str) -> Located:
        self.reason = reason
        T_map_base = se2.compose(self._map.walls.T_map_grid, place.fit.pose)
        T_map_odom = se2.compose(T_map_base, se2.inverse(T_odom_base))
        covariance = covariance_of(place.fit, self._map.walls.T_map_grid[2])
        return Located(stamp_ns, T_map_base, T_map_odom, covariance, place.evidence.hit_share, reason)


def find_places(reference: ReferenceMap, seen: Sighting, settings: RelocalisationSettings) -> list[Place]:
    """Return the distinct places where what was seen fits best, refined and judged, best supported first."""
    if reference.field is None or len(seen.points) == 0:
        return []
    peaks = search_everywhere(
        reference.field,
        _every_nth(seen.points, _SEARCH_POINTS),
        least_score=settings.least_score,
        least_share=settings.least_share,
        most=settings.places,
        apart_m=_APART_M,
        apart_rad=_APART_RAD,
        where=reference.standing,
    )
    chosen, facings_rad = _every_nth(seen.points, _REFINE_POINTS), _every_nth(seen.facings_rad, _REFINE_POINTS)
    places: list[Place] = []
    for peak in peaks:
        fit = refine(reference.faces, chosen, facings_rad, peak.pose)
        if not any(_is_same(fit.pose, place.fit.pose) for place in places):
            evidence = judge(reference.faces, seen.points, seen.facings_rad, seen.origins, fit.pose)
            places.append(Place(fit, evidence))
    return sorted(places, key=lambda place: -place.support)


def _is_same(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.hypot(*(a - b)[:2]) < _SAME_M and abs(se2.wrap_angle(a[2] - b[2])) < _SAME_RAD)


def _every_nth(points: FloatArray, most: int) -> FloatArray:
    """Return at most so many of the points (N, ...), evenly picked."""
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).astype(np.int64)]


def _rival_share(places: list[Place]) -> float:
    """Return the second-best place's support as a share of the best one's."""
    if len(places) < 2:
        return 0.0
    return max(places[1].support, 0.0) / places[0].support if places[0].support > 0 else 1.0


def _in_words(evidence: Evidence) -> str:
    return (
        f"{evidence.hit_share:.0%} of {evidence.known} points on walls, {evidence.contradiction:.0%} in free space or "
        "seen through walls"
    )
