"""Loop closure: has the robot been here before, and where exactly relative to then?

Earlier keyframes near the estimated pose are candidates, one for each time that the robot passed. The last piece of the
drive is searched for in the map of the piece around the candidate, by branch and bound over a window as large as the
drift may be; the result is refined point to line and must show agreeing walls, few contradictions and no rival place.
What would move the robot far must be found twice, from two pieces of the drive that share no scan.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.correlation import SearchWindow, likelihood_field, search
from mapping.keyframes import Clouds
from mapping.pose_graph import Constraints, GraphSolution, optimise, shortest_ways
from mapping.scan_matching import Agreement, Group, group_agreement, match_groups

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_GATES_M = (0.3, 0.2, 0.15, 0.1, 0.1)
_MOST_FIELD_POINTS = 200_000


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How loops are looked for and believed.

    least_path_m: driven since the candidate at the least. Candidates are nearer than reach_m plus the drift, which
    grows from first_drift_m and first_turn_rad with the way to the candidate along the graph, up to most_drift_m and
    most_turn_rad: a closure shortens that way, a doubtful step counts as doubtful_m; `candidates` passes at most are
    tried, with half_group keyframes to each side. least_score,
    most_rival: of the search (a rival is rival_apart_m away or turned). least_hit_share, least_overlap, tolerance_m: of
    the agreement after refinement. A closure that moves the query more than surprise_m or surprise_rad is believed once
    a second one agrees within agree_m and agree_rad. kernels: Cauchy's scales in standard deviations, one after the
    other; a closure with a squared normalised error over withdrawn_chi2 after optimisation is withdrawn.
    """

    least_path_m: float = 10.0
    reach_m: float = 4.0
    first_drift_m: float = 0.5
    drift_share: float = 0.03
    most_drift_m: float = 8.0
    first_turn_rad: float = 0.15
    turn_per_m: float = 0.005
    most_turn_rad: float = 0.7
    doubtful_m: float = 5.0
    candidates: int = 3
    half_group: int = 6
    resolution_m: float = 0.05
    field_sigma_m: float = 0.1
    search_points: int = 250
    least_score: float = 0.5
    rival_apart_m: float = 0.6
    most_rival: float = 0.92
    least_hit_share: float = 0.92
    least_overlap: float = 0.2
    tolerance_m: float = 0.1
    surprise_m: float = 0.5
    surprise_rad: float = 0.1
    agree_m: float = 0.3
    agree_rad: float = 0.04
    kernels: tuple[float, ...] = (20.0, 3.0)
    withdrawn_chi2: float = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """A loop: the pose (3,) of keyframe `second` in `first`, with its information (3, 3) in second's frame."""

    first: int
    second: int
    T_first_second: FloatArray
    information: FloatArray
    score: float
    rival: float
    agreement: Agreement


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What is known of a drive at one instant: K keyframes with their estimated poses (K, 3) and metres driven (K,).

    segments (K,): number of the piece that a keyframe belongs to; tracking was lost between two pieces. steps: the
    front end's relative poses; closures: the loops believed so far.
    """

    clouds: Clouds
    poses: FloatArray
    travelled: FloatArray
    segments: IndexArray
    steps: Constraints
    closures: tuple[Closure, ...]

    def components(self) -> IndexArray:
        """Return for each keyframe (K,) the lowest number of the segments that closures tie its own to."""
        return components_of(self.segments, self.closures)


@dataclass(frozen=True, slots=True, eq=False)
class LoopOutcome:
    """The closures believed from now on, optimised poses (K, 3), and what was done."""

    closures: tuple[Closure, ...]
    poses: FloatArray
    found: int = 0
    unconfirmed: int = 0


def close_loops(drive: Drive, query: int, settings: LoopSettings, *, renewed: bool = False) -> LoopOutcome:
    """Look for loops of keyframe `query` with the past, and optimise the graph where that changes it.

    renewed: measurements have changed since the last time, so it must be optimised in any case.
    """
    found, unconfirmed = find_closures(drive, query, settings)
    if not found and not renewed:
        return LoopOutcome(drive.closures, drive.poses, unconfirmed=unconfirmed)
    closures = (*drive.closures, *found)
    placed = replace(drive, poses=_joined(drive, found))
    return LoopOutcome(closures, settle(placed, closures, settings, 3), len(found), unconfirmed)


def _joined(drive: Drive, found: list[Closure]) -> FloatArray:
    """Return poses (K, 3) with each piece that a closure newly ties to an older one moved there as a whole.

    From where a lost robot thought that it was, turned by half a circle perhaps, the optimiser would not find the way.
    """
    poses: FloatArray = drive.poses.copy()
    components = drive.components()
    for closure in found:
        one, other = components[closure.first], components[closure.second]
        if one == other:
            continue
        place = se2.compose(poses[closure.first], closure.T_first_second)
        moved = se2.compose(place, se2.inverse(poses[closure.second]))
        newer = components == max(one, other)
        poses[newer] = se2.compose(moved if other > one else se2.inverse(moved), poses[newer])
        components[newer] = min(one, other)
    return poses


def settle(drive: Drive, closures: tuple[Closure, ...], settings: LoopSettings, iterations: int) -> FloatArray:
    """Return optimised poses (K, 3): graduated, so that a loop may first move the map and is doubted afterwards.

    Wrong closures that agree with each other may move the map as well, and then it is the real ones that are doubted.
    So, where any is contradicted in the end, the map as it was is settled with doubt from the outset; the better one is
    kept.
    """
    constraints = drive.steps.joined(constraints_of(closures))
    moved = _optimised(drive.poses, constraints, settings.kernels, iterations)
    if not (constraints.robust & (moved.chi2 > settings.withdrawn_chi2)).any():
        return moved.poses
    kept = _optimised(drive.poses, constraints, settings.kernels[-1:], iterations)
    return moved.poses if moved.cost <= kept.cost else kept.poses


def _optimised(
    poses: FloatArray, constraints: Constraints, kernels: tuple[float, ...], iterations: int
) -> GraphSolution:
    """Return the solution with the last of the kernels, from those with the kernels before it."""
    solution = optimise(poses, constraints, kernel=kernels[0], iterations=iterations)
    for kernel in kernels[1:]:
        solution = optimise(solution.poses, constraints, kernel=kernel, iterations=iterations)
    return solution


def components_of(segments: IndexArray, closures: tuple[Closure, ...]) -> IndexArray:
    """Return for each keyframe (K,) of the segments (K,), K >= 1, the lowest number of those tied to its own."""
    label = np.arange(int(segments[-1]) + 1)
    for closure in closures:
        one, other = label[segments[closure.first]], label[segments[closure.second]]
        label[label == max(one, other)] = min(one, other)
    return np.asarray(label[segments])


def constraints_of(closures: tuple[Closure, ...]) -> Constraints:
    """Return closures as robust constraints."""
    return Constraints(
        np.array([closure.first for closure in closures], dtype=np.int64),
        np.array([closure.second for closure in closures], dtype=np.int64),
        np.array([closure.T_first_second for closure in closures]).reshape(-1, 3),
        np.array([closure.information for closure in closures]).reshape(-1, 3, 3),
        np.ones(len(closures), np.bool_),
    )


def find_closures(drive: Drive, query: int, settings: LoopSettings) -> tuple[list[Closure], int]:
    """Return the believed closures of keyframe `query` with earlier passes, and how many lacked confirmation."""
    components = drive.components()
    believed, unconfirmed = [], 0
    for closure in _closures_of(drive, components, query, settings):
        surprising = _is_surprising(drive, closure, settings) or components[closure.first] != components[query]
        if not surprising or _is_confirmed(drive, components, closure, settings):
            believed.append(closure)
        else:
            unconfirmed += 1
    return believed, unconfirmed


def _closures_of(drive: Drive, components: IndexArray, query: int, settings: LoopSettings) -> list[Closure]:
    """Return what the search finds for one keyframe: in its own component nearby, in an older one anywhere."""
    way_m = _ways(drive, query, settings)
    drift_m = np.minimum(settings.first_drift_m + settings.drift_share * way_m, settings.most_drift_m)
    turn_rad = np.minimum(settings.first_turn_rad + settings.turn_per_m * way_m, settings.most_turn_rad)
    candidates = [
        (
            candidate,
            se2.between(drive.poses[candidate], drive.poses[query]),
            SearchWindow(float(drift_m[candidate]), float(turn_rad[candidate])),
        )
        for candidate in _candidates(drive, components, query, settings.reach_m + drift_m, settings)
    ]
    if components[query] != 0:
        candidates += _anywhere(drive, components, query, settings)
    found = [_match_place(drive, candidate, query, guess, around, settings) for candidate, guess, around in candidates]
    return [closure for closure in found if closure is not None]


def _ways(drive: Drive, query: int, settings: LoopSettings) -> FloatArray:
    """Return how far (K,) each keyframe is from the query along steps and closures: over that odometry may drift."""
    steps, closures = drive.steps, drive.closures
    lengths = np.hypot(*steps.T_first_second[:, :2].T) + np.where(steps.robust, settings.doubtful_m, 0.0)
    known = steps.information[:, 2, 2] > 1.0  # not over a loss
    first = np.concatenate([steps.first[known], np.array([each.first for each in closures], dtype=np.int64)])
    second = np.concatenate([steps.second[known], np.array([each.second for each in closures], dtype=np.int64)])
    lengths = np.concatenate([lengths[known], np.zeros(len(closures))])
    return shortest_ways(len(drive.poses), first, second, lengths, query)


def _candidates(
    drive: Drive, components: IndexArray, query: int, reach_m: FloatArray, settings: LoopSettings
) -> list[int]:
    """Return the nearest keyframe of each earlier pass, the nearest passes first."""
    distance = np.hypot(*(drive.poses[:query, :2] - drive.poses[query, :2]).T)
    is_past = drive.travelled[query] - drive.travelled[:query] > settings.least_path_m
    is_near = (distance < reach_m[:query]) & is_past & (components[:query] == components[query])
    near = np.flatnonzero(is_near)
    if len(near) == 0:
        return []
    passes = np.split(near, np.flatnonzero(np.diff(near) > settings.half_group) + 1)
    nearest = [int(each[np.argmin(distance[each])]) for each in passes]
    return sorted(nearest, key=lambda keyframe: (distance[keyframe], keyframe))[: settings.candidates]


def _anywhere(
    drive: Drive, components: IndexArray, query: int, settings: LoopSettings
) -> list[tuple[int, FloatArray, SearchWindow]]:
    """Return where in the first component the query fits best, with any heading: candidate, guess and window."""
    known = np.flatnonzero(components == 0)
    points = np.vstack(
        [se2.transform_points(drive.poses[each], drive.clouds.points_of(int(each))[::3]) for each in known]
    )
    points = points[:: max(1, len(points) // _MOST_FIELD_POINTS)]
    field = likelihood_field(points, 2.0 * settings.resolution_m, settings.field_sigma_m)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reach_m = float(np.ptp(points, axis=0).max()) / 2.0
    peak = search(
        field, _piece(drive, query, settings), np.array([*middle, 0.0]), SearchWindow(reach_m, np.pi),
        least_score=settings.least_score, rival_apart_m=2.0 * settings.rival_apart_m,
    )  # fmt: skip
    if peak is None or peak.rival > settings.most_rival * peak.score:
        return []
    nearest = int(known[np.argmin(np.hypot(*(drive.poses[known, :2] - peak.pose[:2]).T))])
    guess = se2.between(drive.poses[nearest], peak.pose)
    return [(nearest, guess, SearchWindow(settings.first_drift_m, settings.first_turn_rad))]


def _match_place(
    drive: Drive, candidate: int, query: int, guess: FloatArray, window: SearchWindow, settings: LoopSettings
) -> Closure | None:
    """Search, refine and verify the query around one candidate."""
    around = _group(drive, candidate, settings.half_group, 1)
    field = likelihood_field(_points(drive.clouds, around), settings.resolution_m, settings.field_sigma_m)
    peak = search(
        field, _piece(drive, query, settings), guess, window, least_score=settings.least_score,
        rival_apart_m=settings.rival_apart_m,
    )  # fmt: skip
    if peak is None or peak.rival > settings.most_rival * peak.score:
        return None
    moving, fixed = _group(drive, query, settings.half_group, 3), _group(drive, candidate, settings.half_group, 2)
    match = match_groups(drive.clouds, moving, fixed, peak.pose, _GATES_M, stride=2)
    agreed = group_agreement(drive.clouds, moving, fixed, match.pose, settings.tolerance_m, stride=4)
    if agreed.hit_share < settings.least_hit_share or agreed.overlap < settings.least_overlap:
        return None
    return Closure(candidate, query, match.pose, match.information_with(), peak.score, peak.rival, agreed)


def _is_surprising(drive: Drive, closure: Closure, settings: LoopSettings) -> bool:
    """Whether a closure would move the robot by more than odometry should have drifted."""
    expected = se2.between(drive.poses[closure.first], drive.poses[closure.second])
    off = se2.between(expected, closure.T_first_second)
    return bool(np.hypot(off[0], off[1]) > settings.surprise_m or abs(off[2]) > settings.surprise_rad)


def _is_confirmed(drive: Drive, components: IndexArray, closure: Closure, settings: LoopSettings) -> bool:
    """Whether the piece of the drive before the query's, searched for by itself, ends in the same place."""
    apart = 2 * settings.half_group + 1
    for other in (closure.second - apart, closure.second - 2 * apart):
        if other < 0 or drive.segments[other] != drive.segments[closure.second]:
            continue
        for second in _closures_of(drive, components, other, settings):
            if components[second.first] == components[closure.first] and _agree(drive, closure, second, settings):
                return True
    return False


def _agree(drive: Drive, one: Closure, other: Closure, settings: LoopSettings) -> bool:
    """Whether two closures of neighbouring queries put the robot in one place."""
    place_one = se2.compose(drive.poses[one.first], one.T_first_second)
    place_other = se2.compose(drive.poses[other.first], other.T_first_second)
    driven = se2.between(drive.poses[other.second], drive.poses[one.second])
    off = se2.between(se2.compose(place_other, driven), place_one)
    return bool(np.hypot(off[0], off[1]) <= settings.agree_m and abs(off[2]) <= settings.agree_rad)


def _piece(drive: Drive, query: int, settings: LoopSettings) -> FloatArray:
    """Return the points (N, 2) of the drive around the query, in its frame, thinned."""
    points = _points(drive.clouds, _group(drive, query, settings.half_group, 1))
    return points[:: max(1, len(points) // settings.search_points)]


def _points(clouds: Clouds, group: Group) -> FloatArray:
    """Return the points (N, 2) of a group in its own frame."""
    parts = [clouds.points_of(int(each)) for each in group.keyframes]
    return np.vstack([se2.transform_points(pose, part) for pose, part in zip(group.poses, parts, strict=True)])


def _group(drive: Drive, center: int, half: int, every: int) -> Group:
    """Return each `every`-th keyframe, up to `half` to each side in the same segment, in the frame of the centre."""
    low, high = max(0, center - half), min(len(drive.poses) - 1, center + half)
    keyframes = np.unique([*range(center, low - 1, -every), *range(center, high + 1, every)]).astype(np.int64)
    keyframes = keyframes[drive.segments[keyframes] == drive.segments[center]]
    return Group(keyframes, se2.between(drive.poses[center], drive.poses[keyframes]))
