"""The default registration: many places from a search over all rotations, weighed by what speaks for each.

1. survey: walls, outlines and free space of both maps, at a bounded size.
2. hypotheses: correlation of their layers at a coarse cell, feature matches, refinement of each on the distance field.
3. evidence: metres of wall that agree and contradict, areas, rivals.
4. ranking: a learned probability for each.
5. verdict: accepted only if the best is very probable, no other place is, and the walls hold it in every direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment, Alternative
from fusion.evidence import Evidence, different_places, gather
from fusion.hypotheses import DEEP, FAST, Pool, find_hypotheses, match_features
from fusion.identity import reference_rank
from fusion.ranking import Ranking, probabilities, shipped_ranking
from fusion.settling import UncertaintyModel, settle
from fusion.survey import SurveyedMap, survey
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_agreement import net_metres

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LayeredSettings:
    """What a pose must reach to be believed, and when to look harder.

    accept: probability from which a pose is believed. least_wall_m: of wall that both maps must show in one place;
    least_weak_m: of it, how much must hold the pose in its weakest direction. ambiguous: share of the best one's
    probability at which another place makes it a toss. sure: below this probability a deep search follows the fast one.
    listed: alternatives are named from this probability on, and at most most_listed.
    """

    accept: float = 0.9
    least_wall_m: float = 3.0
    least_weak_m: float = 0.5
    ambiguous: float = 0.3
    listed: float = 0.05
    most_listed: int = 4
    sure: float = 0.97
    uncertainty: UncertaintyModel = UncertaintyModel()


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """All hypotheses of two maps with their evidence and, for each, its probability (K,) by itself.

    best: number of the most probable one; score: that it is right and no other place is.
    """

    a: SurveyedMap
    b: SurveyedMap
    pool: Pool
    evidence: Evidence
    probability: FloatArray
    best: int
    score: float


def register_layers(
    a: OccupancyGrid,
    b: OccupancyGrid,
    settings: LayeredSettings | None = None,
    ranking: Ranking | None = None,
    seed: int = 0,
) -> Alignment:
    """Find the pose of map b in the frame of map a; exchanging the two gives exactly the inverse.

    Maps that cannot be aligned at all are refused with a reason, as are poses that cannot be trusted. The ranking is
    the one that comes with the program unless another is given.
    """
    if reference_rank(b) < reference_rank(a):
        return register_layers(b, a, settings, ranking, seed).inverse()
    rule = settings or LayeredSettings()
    weights = ranking or shipped_ranking()
    weighed, objection = weigh(a, b, rule, weights, seed)
    if weighed is None:
        return Alignment(None, False, objection)
    return _verdict(weighed, rule, weights)


def weigh(
    a: OccupancyGrid, b: OccupancyGrid, rule: LayeredSettings, ranking: Ranking, seed: int
) -> tuple[Weighed | None, str]:
    """Return the hypotheses with their probabilities, or None and why there cannot be any.

    Where a fast search leaves doubt, a deep one follows.
    """
    maps = survey(a), survey(b)
    for surveyed, name in zip(maps, ("one", "the other"), strict=True):
        if surveyed.free_m2 == 0.0:
            return None, f"{name} map has no free cell"
        if surveyed.wall_m == 0.0:
            return None, f"{name} map has no wall beside free space: nothing to place it by"
    matches = match_features(*maps)
    weighed = _weighed(*maps, find_hypotheses(*maps, matches, FAST, seed=seed), ranking)
    if ranking.calibrated(weighed.score) < rule.sure:
        pool = find_hypotheses(*maps, matches, DEEP, seed=seed, earlier=weighed.pool)
        weighed = _weighed(*maps, pool, ranking)
    return weighed, ""


def _weighed(a: SurveyedMap, b: SurveyedMap, pool: Pool, ranking: Ranking) -> Weighed:
    """Rank a pool."""
    evidence = gather(a, b, pool)
    probability = probabilities(ranking.log_odds(evidence.features))
    best = int(np.argmax(probability))
    others = different_places(pool.poses, b)[best]
    rival = float(probability[others].max()) if others.any() else 0.0
    return Weighed(a, b, pool, evidence, probability, best, float(probability[best]) * (1.0 - rival))


def _verdict(weighed: Weighed, rule: LayeredSettings, ranking: Ranking) -> Alignment:
    """Return the best hypothesis, settled, and whether to believe it."""
    a, b, best = weighed.a, weighed.b, weighed.best
    settled = settle(a, b, weighed.pool.poses[best], rule.uncertainty)
    probability = ranking.calibrated(weighed.score)
    against = _objection(weighed, probability, rule)
    reason = against or (
        f"{_wall_m(weighed):.0f} m of wall agree and {_conflict_m(weighed):.1f} m contradict; "
        f"no other place comes near (probability {probability:.3f})"
    )
    return Alignment(
        _in_map_frames(a, b, settled.pose),
        against is None,
        reason,
        inliers=int(weighed.pool.matches[best]),
        acceptance=float(weighed.evidence.omega[best]),
        overlap=weighed.evidence.overlap(best),
        probability=probability,
        covariance=_covariance_in_map_frames(a, b, settled.pose, settled.covariance),
        alternatives=_alternatives(weighed, rule, ranking),
    )


def _wall_m(weighed: Weighed) -> float:
    """Return the metres of wall that both maps show in one place at the best hypothesis."""
    hits = [each.hits[weighed.best, 1] for each in (weighed.evidence.b_on_a, weighed.evidence.a_on_b)]
    return float(min(hits))


def _conflict_m(weighed: Weighed) -> float:
    """Return the metres of wall of either map that stand in the other's free space."""
    return float(sum(each.conflicts[weighed.best, 1] for each in (weighed.evidence.b_on_a, weighed.evidence.a_on_b)))


def _objection(weighed: Weighed, probability: float, rule: LayeredSettings) -> str | None:
    """Return in words what speaks most against the best hypothesis; None if it is to be believed."""
    wall_m, conflict_m = _wall_m(weighed), _conflict_m(weighed)
    if wall_m < rule.least_wall_m:
        return f"only {wall_m:.1f} m of wall are seen in both maps, {rule.least_wall_m:g} m are needed"
    weak_m = min(float(each.weak[weighed.best]) for each in (weighed.evidence.b_on_a, weighed.evidence.a_on_b))
    rival = _strongest_rival(weighed)
    if rival is not None and weighed.probability[rival] > rule.ambiguous * weighed.probability[weighed.best]:
        x, y, yaw = _in_map_frames(weighed.a, weighed.b, weighed.pool.poses[rival]).tolist()
        return (
            f"ambiguous: another place fits as well (x {x:.1f} m, y {y:.1f} m, {math.degrees(yaw):.0f} deg; "
            f"{weighed.probability[rival]:.0%} against {weighed.probability[weighed.best]:.0%})"
        )
    if weak_m < rule.least_weak_m:
        back_m, ahead_m = slide(weighed)
        return (
            f"the corridor slides {back_m:.1f} m one way and {ahead_m:.1f} m the other: "
            f"only {weak_m:.1f} m of wall hold it along its length, {rule.least_weak_m:g} m are needed"
        )
    if probability >= rule.accept:
        return None
    words = f"{wall_m:.0f} m of wall agree, {conflict_m:.0f} m contradict, acceptance index "
    words += f"{weighed.evidence.omega[weighed.best]:.3f}"
    return f"not sure enough: probability {probability:.2f}, {rule.accept:g} is needed ({words})"


def _strongest_rival(weighed: Weighed) -> int | None:
    """Return the most probable hypothesis at another place than the best one."""
    others = np.flatnonzero(different_places(weighed.pool.poses, weighed.b)[weighed.best])
    return int(others[np.argmax(weighed.probability[others])]) if len(others) else None


def slide(weighed: Weighed) -> tuple[float, float]:
    """Return how far in m the best hypothesis can be moved along its weakest direction before walls object."""
    best, forth = weighed.pool.poses[weighed.best], weighed.evidence.b_on_a
    direction = float(forth.weak_direction[weighed.best])
    steps = np.arange(-80, 81) * 0.25
    shifted = np.repeat(best[np.newaxis], len(steps), axis=0)
    shifted[:, 0] += steps * math.cos(direction)
    shifted[:, 1] += steps * math.sin(direction)
    cell_m = max(weighed.a.walls.resolution_m, weighed.b.walls.resolution_m)
    net = net_metres(weighed.a.surface, weighed.b.probe, shifted, cell_m)[:, 1]
    good = net >= 0.7 * net[80]
    ahead = int(np.argmin(np.append(good[80:], False)))
    back = int(np.argmin(np.append(good[80::-1], False)))
    return 0.25 * max(back - 1, 0), 0.25 * max(ahead - 1, 0)


def _alternatives(weighed: Weighed, rule: LayeredSettings, ranking: Ranking) -> tuple[Alternative, ...]:
    """Return the places other than the best that are not improbable, the most probable first."""
    different = different_places(weighed.pool.poses, weighed.b)
    listed = [weighed.best]
    for n in np.argsort(-weighed.probability, kind="stable").tolist():
        if weighed.probability[n] < rule.listed or len(listed) > rule.most_listed:
            break
        if different[n, listed].all():
            listed.append(n)
    best = float(weighed.probability[weighed.best])
    return tuple(
        Alternative(
            _in_map_frames(weighed.a, weighed.b, weighed.pool.poses[n]),
            ranking.calibrated(float(weighed.probability[n]) * (1.0 - best)),
        )
        for n in listed[1:]
    )


def _in_map_frames(a: SurveyedMap, b: SurveyedMap, pose: FloatArray) -> FloatArray:
    """Return the pose (3,) of map b's frame in map a's, of that of the grids."""
    return se2.compose(se2.compose(a.walls.T_map_grid, pose), se2.inverse(b.walls.T_map_grid))


def _covariance_in_map_frames(a: SurveyedMap, b: SurveyedMap, pose: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance (3, 3) of x, y, yaw of map b's frame in map a's, of that of the grids."""
    turn, inside = a.walls.T_map_grid[2], se2.inverse(b.walls.T_map_grid)
    lever = se2.transform_points(np.array([0.0, 0.0, pose[2]]), inside[:2])
    cos, sin = math.cos(turn), math.sin(turn)
    onto = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    onto = onto @ np.array([[1.0, 0.0, -lever[1]], [0.0, 1.0, lever[0]], [0.0, 0.0, 1.0]])
    return np.asarray(onto @ covariance @ onto.T)
