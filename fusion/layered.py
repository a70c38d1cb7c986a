"""The default registration: many places from a search over all rotations, weighed by what speaks for each.

1. survey: walls, outlines and free space of both maps, at a bounded size.
2. hypotheses: correlation of their layers at a coarse cell, feature matches, refinement of each on the distance field.
3. evidence: metres of wall that agree and contradict, areas, rivals.
4. ranking: a learned probability for each.
5. verdict: accepted only if the best is very probable, no other place is, and the walls hold it in every direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment, Alternative
from fusion.evidence import Evidence, different_places, judged_places
from fusion.hypotheses import Pool
from fusion.identity import precedes
from fusion.ranking import Ranking, probabilities, shipped_ranking
from fusion.settling import UncertaintyModel, settle
from fusion.survey import FREE_BELOW, SurveyedMap, survey
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_agreement import net_metres

FloatArray = NDArray[np.float64]
_SLIDE_STEP_M, _SLIDE_STEPS, _SLIDE_KEEPS = 0.25, 80, 0.7


@dataclass(frozen=True, slots=True)
class LayeredSettings:
    """What a pose must reach to be believed.

    accept: probability from which a pose is believed; accept_clear: the same where both maps show long_wall_m or more
    in one place, which is more than the walls of one room, or where no other place has as much of it and their areas
    agree to clear_areas, an acceptance index: two rooms of one size, the commonest mistake, differ in what stands in
    them and lies around them. least_wall_m: of wall that both maps must show in one place; least_weak_m: of it, how
    much must hold the pose in its weakest direction. ambiguous: if the best place's probability is at least `likely`,
    another place makes it a toss whose own is over one half, or which has more than this share of the two, of which one
    alone can be right. listed: alternatives are named from this probability on, and at most most_listed. twin_hits,
    twin_conflicts: a pose of at least the probability `listed` that is not believed is ambiguous if it and another
    place each have at most this share of contradicting wall, and the other at least this share of the best one's
    agreeing wall.
    """

    accept: float = 0.95
    accept_clear: float = 0.9
    long_wall_m: float = 20.0
    clear_areas: float = 0.97
    least_wall_m: float = 3.0
    least_weak_m: float = 0.5
    likely: float = 0.15
    ambiguous: float = 0.05
    listed: float = 0.05
    most_listed: int = 4
    twin_hits: float = 0.85
    twin_conflicts: float = 0.05
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
    rule, weights = settings or LayeredSettings(), ranking or shipped_ranking()
    for grid, name in ((a, "first"), (b, "second")):
        if not (grid.log_odds < FREE_BELOW).any():
            return Alignment(None, False, f"the {name} map has no cell that is free with p(free) > 0.65")
    if precedes(b, a):
        return _register(b, a, rule, weights, seed, ("second", "first")).inverse()
    return _register(a, b, rule, weights, seed, ("first", "second"))


def _register(
    a: OccupancyGrid, b: OccupancyGrid, rule: LayeredSettings, ranking: Ranking, seed: int, names: tuple[str, str]
) -> Alignment:
    """Run the steps; names say which argument each map was."""
    maps = survey(a), survey(b)
    for surveyed, name in zip(maps, names, strict=True):
        if surveyed.wall_m == 0.0:
            return Alignment(None, False, f"the {name} map has no wall beside free space: nothing to place it by")
    return _verdict(_weighed(*maps, ranking, seed), rule, ranking)


def _weighed(a: SurveyedMap, b: SurveyedMap, ranking: Ranking, seed: int) -> Weighed:
    """Find hypotheses and rank them."""
    pool, evidence = judged_places(a, b, seed)
    probability = probabilities(ranking.log_odds(evidence.features))
    best = int(np.argmax(probability))
    others = different_places(pool.poses, b)[best]
    rival = float(probability[others].max()) if others.any() else 0.0
    return Weighed(a, b, pool, evidence, probability, best, float(probability[best]) * (1.0 - rival))


def _verdict(weighed: Weighed, rule: LayeredSettings, ranking: Ranking) -> Alignment:
    """Return the best hypothesis, settled, and whether to believe it."""
    a, b, best, evidence = weighed.a, weighed.b, weighed.best, weighed.evidence
    hopeful = bool(weighed.probability[best] >= rule.listed)
    settled = settle(a, b, weighed.pool.poses[best], rule.uncertainty, restart=hopeful)
    probability = ranking.calibrated(weighed.score)
    wall_m = float(min(evidence.b_on_a.hits[best, 1], evidence.a_on_b.hits[best, 1]))
    conflict_m = float(evidence.b_on_a.conflicts[best, 1] + evidence.a_on_b.conflicts[best, 1])
    found = Alignment(
        _in_map_frames(a, b, settled.pose),
        accepted=True,
        reason=f"{wall_m:.0f} m of wall agree and {conflict_m:.1f} m contradict, no other place comes near",
        inliers=int(weighed.pool.matches[best]),
        acceptance=float(evidence.omega[best]),
        overlap=evidence.overlap(best),
        probability=probability,
        covariance=_covariance_in_map_frames(a, b, settled.pose, settled.covariance),
        alternatives=_alternatives(weighed, rule, ranking, None),
        common_wall_m=wall_m,
        conflict_m=conflict_m,
    )
    if wall_m < rule.least_wall_m:
        reason = f"only {wall_m:.1f} m of wall are seen in both maps, {rule.least_wall_m:g} m are needed"
        return replace(found, accepted=False, reason=reason)
    rival = _strongest_rival(weighed)
    best_p = float(weighed.probability[best])
    if rival is not None and best_p >= rule.likely and _rivals(best_p, float(weighed.probability[rival]), rule):
        return _toss(found, weighed, rival, rule, ranking)
    # Corners and furniture hold a pose in every direction, half a metre for each metre.
    weak_m = min(float(each.weak[best] + 0.5 * each.rough[best]) for each in (evidence.b_on_a, evidence.a_on_b))
    if weak_m < rule.least_weak_m:
        direction, reach_m = slide(weighed)
        slides = f"the corridor slides {reach_m:.1f} m either way: " if reach_m > 0.0 else ""
        reason = f"{slides}only {weak_m:.1f} m of wall hold its weakest direction, {rule.least_weak_m:g} m are needed"
        direction += float(a.walls.T_map_grid[2])
        return replace(found, accepted=False, reason=reason, slide=(direction, reach_m))
    needed = rule.accept_clear if wall_m >= rule.long_wall_m else rule.accept
    if probability >= needed:
        return found
    twin = _twin(weighed, rule) if hopeful else None
    if twin is not None:
        return _toss(found, weighed, twin, rule, ranking)
    needed = rule.accept_clear if found.acceptance >= rule.clear_areas else needed
    if probability >= needed:
        return found
    reason = (
        f"not sure enough: probability {probability:.2f}, {needed:g} is needed ({wall_m:.0f} m of wall agree, "
        f"{conflict_m:.1f} m contradict, acceptance index {found.acceptance:.3f})"
    )
    return replace(found, accepted=False, reason=reason)


def _rivals(best: float, other: float, rule: LayeredSettings) -> bool:
    """Tell whether two places of such probabilities, each by itself, leave open which of them is right."""
    one, two = best * (1.0 - other), other * (1.0 - best)
    return other > 0.5 or two > rule.ambiguous * (one + two)


def _toss(found: Alignment, weighed: Weighed, rival: int, rule: LayeredSettings, ranking: Ranking) -> Alignment:
    """Return what was found as ambiguous: the rival is as good."""
    return replace(
        found,
        accepted=False,
        ambiguous=True,
        reason=_toss_in_words(weighed, rival),
        alternatives=_alternatives(weighed, rule, ranking, rival),
    )


def _strongest_rival(weighed: Weighed) -> int | None:
    """Return the most probable hypothesis at another place than the best one."""
    others = np.flatnonzero(different_places(weighed.pool.poses, weighed.b)[weighed.best])
    return int(others[np.argmax(weighed.probability[others])]) if len(others) else None


def _twin(weighed: Weighed, rule: LayeredSettings) -> int | None:
    """Return the hypothesis elsewhere whose walls agree most, if they do so about as well as the best one's: repeating
    rooms and corridors leave each of their places improbable.
    """
    forth, back = weighed.evidence.b_on_a, weighed.evidence.a_on_b
    hits, conflicts = (
        0.5 * (each + other)[:, 1] for each, other in ((forth.hits, back.hits), (forth.conflicts, back.conflicts))
    )
    fits = (conflicts <= rule.twin_conflicts * hits) & (hits >= rule.twin_hits * hits[weighed.best])
    others = np.flatnonzero(different_places(weighed.pool.poses, weighed.b)[weighed.best] & fits)
    if not fits[weighed.best] or len(others) == 0:
        return None
    return int(others[np.argmax(hits[others] - conflicts[others])])


def _toss_in_words(weighed: Weighed, rival: int) -> str:
    """Return why the best place is not better than a rival."""
    best, other = weighed.pool.poses[weighed.best], weighed.pool.poses[rival]
    middle = weighed.b.probe.points.mean(axis=0)
    apart = se2.transform_points(best, middle) - se2.transform_points(other, middle)
    turned = abs(math.degrees(float(se2.wrap_angle(best[2] - other[2]))))
    hits = [
        min(float(each.hits[n, 1]) for each in (weighed.evidence.b_on_a, weighed.evidence.a_on_b))
        for n in (weighed.best, rival)
    ]
    return (
        f"ambiguous: another place, {math.hypot(*apart):.1f} m away and turned by {turned:.0f} deg, fits about as well "
        f"({hits[1]:.0f} m of wall agree there, {hits[0]:.0f} m here)"
    )


def slide(weighed: Weighed) -> tuple[float, float]:
    """Return the weakest direction in grid a's frame in rad, and how far in m the best hypothesis can move along it
    before walls object: the way that is shorter.
    """
    best = weighed.pool.poses[weighed.best]
    direction = float(weighed.evidence.b_on_a.weak_direction[weighed.best])
    steps = np.arange(-_SLIDE_STEPS, _SLIDE_STEPS + 1) * _SLIDE_STEP_M
    shifted = np.repeat(best[np.newaxis], len(steps), axis=0)
    shifted[:, 0] += steps * math.cos(direction)
    shifted[:, 1] += steps * math.sin(direction)
    cell_m = max(weighed.a.walls.resolution_m, weighed.b.walls.resolution_m)
    net = net_metres(weighed.a.surface, weighed.b.probe, shifted, cell_m)[:, 1]
    good = net >= _SLIDE_KEEPS * net[_SLIDE_STEPS]
    ways = (np.append(good[_SLIDE_STEPS:], False), np.append(good[_SLIDE_STEPS::-1], False))
    return direction, _SLIDE_STEP_M * max(min(int(np.argmin(way)) for way in ways) - 1, 0)


def _alternatives(
    weighed: Weighed, rule: LayeredSettings, ranking: Ranking, rival: int | None
) -> tuple[Alternative, ...]:
    """Return the rival, if there is one, and then the other places that are not improbable, the best first."""
    different = different_places(weighed.pool.poses, weighed.b)
    listed = [weighed.best] if rival is None else [weighed.best, rival]
    for n in np.argsort(-weighed.probability, kind="stable").tolist():
        if weighed.probability[n] < rule.listed or len(listed) > rule.most_listed:
            break
        if different[n, listed].all():
            listed.append(n)
    best = float(weighed.probability[weighed.best])
    likely = [ranking.calibrated(float(weighed.probability[n]) * (1.0 - best)) for n in listed[1:]]
    # The places exclude each other: all together they are no more probable than that the best one is wrong.
    share = min(1.0, (1.0 - ranking.calibrated(weighed.score)) / max(sum(likely), 1e-9))
    return tuple(
        Alternative(_in_map_frames(weighed.a, weighed.b, weighed.pool.poses[n]), share * each)
        for n, each in zip(listed[1:], likely, strict=True)
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
