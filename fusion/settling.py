"""The last step of a registration: the pose below a cell, from both maps' walls, and how far it may be off.

The covariance is the cluster-robust ("sandwich") one of Gauss-Newton (Liang and Zeger 1986): walls within a few metres
err alike, because the map is bent there or a thing was moved, so that not points but blocks of wall count as one
measurement each. Where maps are warped the blocks pull apart and the covariance grows; along a corridor nothing pulls
and it grows too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.survey import SurveyedMap
from mapping import se2
from mapping.bending import bend_each
from mapping.map_agreement import Probe, judge_poses, net_metres
from mapping.map_matching import refine_each
from mapping.metrics import align_points
from mapping.wall_map import FAR_M, WallMap

FloatArray = NDArray[np.float64]
_SCALES_M = (0.15, 0.12, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
_SCALE_M = 0.1
_MET_M, _LEAST_MET = 0.15, 20  # a wall so near is met; from so many points on a rigid motion is known
_ROUNDS, _GAIN_M = 3, 0.5  # at most so often, and only for so much more wall, another start is followed
_HELD = 1e-3  # metres of wall that are taken to hold every direction


@dataclass(frozen=True, slots=True)
class UncertaintyModel:
    """What the covariance is made of; fitted to the errors on public pairs of maps, see docs/fusion.md.

    cells: variance of a metre of wall, in squares of the coarser map's cell. spread: factor on what the blocks pull
    apart. bend_m, bend_rad: standard deviation where all walls that agree at 0.25 m do not at 0.12 m: the maps are
    bent, and no rigid motion is right everywhere; straight: the share of such walls in straight maps. floor_m,
    floor_rad: at the least. bent_for_good_m, bent_for_good_share: rms bending from which, and share of the bent maps'
    common wall up to which, no rigid pose is taken to fit.
    """

    cells: float = 0.5
    spread: float = 1.0
    bend_m: float = 3.0
    bend_rad: float = 0.15
    straight: float = 0.03
    floor_m: float = 0.005
    floor_rad: float = 0.0003
    bent_for_good_m: float = 0.25
    bent_for_good_share: float = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """The pose (3,) of grid b in grid a's frame, and its covariance (3, 3)."""

    pose: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Pull:
    """Normal matrix (3, 3) in metres of wall and the blocks' gradients (B, 3), about a middle in map a's frame."""

    matrix: FloatArray
    gradients: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """A pose (3,) refined both ways, how the walls of both maps pull there, and their middle (2,) in map a's frame.

    agreeing_m: metres of wall that agree within 0.12 m less twice those that contradict, of both maps.
    """

    pose: FloatArray
    pulls: tuple[_Pull, _Pull]
    middle: FloatArray
    agreeing_m: float


def settle(
    a: SurveyedMap, b: SurveyedMap, pose: FloatArray, model: UncertaintyModel, *, restart: bool = True
) -> Settled:
    """Refine a pose with the walls of b on those of a and of a on those of b, and say how sure it is.

    A refinement can stick where a part of the walls fits and the rest is off. So it is tried as well from where the
    maps would lie if one could bend, and the pose is kept at which most wall agrees. Of maps that are bent for good no
    rigid pose fits, and the mean of what bending finds is returned: it is off a little everywhere instead of much
    somewhere. restart: False spares that for a pose which will not be believed anyway.
    """
    place = _settled(a, b, pose)
    settled = place.pose
    if restart:
        place, unbent = _restarted(a, b, place, model)
        bent_for_good = unbent.strain_m > model.bent_for_good_m and unbent.rigid_share < model.bent_for_good_share
        settled = _between(*unbent.poses, place.middle) if bent_for_good else place.pose
    cell_m = _coarser_cell_m(a, b)
    bend = max(0.0, _bent_share(a, b, settled, cell_m) - model.straight)
    least = np.array(
        [np.hypot(model.floor_m, model.bend_m * bend)] * 2 + [np.hypot(model.floor_rad, model.bend_rad * bend)]
    )
    return Settled(settled, _covariance(place.pulls, cell_m, settled - [*place.middle, 0.0], least, model))


def _settled(a: SurveyedMap, b: SurveyedMap, pose: FloatArray) -> _Place:
    """Return the pose refined both ways."""
    forth = _refined(a.walls, b.probe, pose)
    back = se2.inverse(_refined(b.walls, a.probe, se2.inverse(pose)))
    middle = se2.transform_points(forth, b.probe.points.mean(axis=0))
    pulls = (
        _pull(a.walls, b.probe, forth, middle, inverted=False),
        _pull(b.walls, a.probe, se2.inverse(back), middle, inverted=True),
    )
    matrix = pulls[0].matrix + pulls[1].matrix
    # The mean of both, each weighed by how well its walls hold it.
    away = _about(back, middle, forth)
    step = np.asarray(np.linalg.solve(matrix + _HELD * np.eye(3), pulls[1].matrix @ away), dtype=np.float64)
    settled = _moved(forth, middle, step)
    return _Place(settled, pulls, middle, _agreeing_m(a, b, settled))


def _restarted(a: SurveyedMap, b: SurveyedMap, place: _Place, model: UncertaintyModel) -> tuple[_Place, _Unbent]:
    """Return the place that starts from where bending would put the maps lead to, and what bending finds there."""
    for number in range(_ROUNDS):
        unbent = _unbent(a, b, place.pose)
        if number > 0 and unbent.strain_m > model.bent_for_good_m:
            return place, unbent
        other = max((_settled(a, b, start) for start in unbent.poses), key=lambda each: each.agreeing_m)
        if other.agreeing_m <= place.agreeing_m + _GAIN_M:
            return place, unbent
        place = other
    return place, _unbent(a, b, place.pose)


@dataclass(frozen=True, slots=True, eq=False)
class _Unbent:
    """Where b lies rigidly if b is bent onto a, and if a is bent onto b; strain_m: the lesser bending of the two;
    rigid_share: of the wall that meets once bent, how much meets without.
    """

    poses: tuple[FloatArray, FloatArray]
    strain_m: float
    rigid_share: float


def _unbent(a: SurveyedMap, b: SurveyedMap, pose: FloatArray) -> _Unbent:
    forth, strain_b, met_b = _rigid_part(a.walls, b.rough, pose)
    back, strain_a, met_a = _rigid_part(b.walls, a.rough, se2.inverse(pose))
    bent_m, rigid_m = met_a + met_b
    return _Unbent((forth, se2.inverse(back)), min(strain_a, strain_b), float(rigid_m / max(bent_m, 1e-9)))


def _rigid_part(walls: WallMap, probe: Probe, pose: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Return the rigid motion nearest to that of the points that bending lays on walls, the bending in m, and the
    metres (2,) of wall that meet bent and as they are.
    """
    bent = bend_each(walls, probe.points, probe.lengths, pose[np.newaxis])
    met, straight = (
        _field_at(walls, points)[0] < _MET_M for points in (bent.placed[0], se2.transform_points(pose, probe.points))
    )
    metres = np.array([probe.lengths[met].sum(), probe.lengths[straight].sum()])
    if np.count_nonzero(met) < _LEAST_MET:
        return pose, 0.0, metres
    return align_points(bent.placed[0][met], probe.points[met]), float(bent.strain_m[0]), metres


def _agreeing_m(a: SurveyedMap, b: SurveyedMap, pose: FloatArray) -> float:
    """Return what `_Place` says of a pose."""
    cell_m = _coarser_cell_m(a, b)
    forth = net_metres(a.surface, b.probe, pose[np.newaxis], cell_m)
    back = net_metres(b.surface, a.probe, se2.inverse(pose)[np.newaxis], cell_m)
    return float(forth[0, 0] + back[0, 0])


def _coarser_cell_m(a: SurveyedMap, b: SurveyedMap) -> float:
    return max(a.walls.resolution_m, b.walls.resolution_m)


def _between(one: FloatArray, other: FloatArray, middle: FloatArray) -> FloatArray:
    """Return the pose half-way between two, as a motion about a middle (2,) in map a's frame."""
    return _moved(one, middle, 0.5 * _about(other, middle, one))


def _bent_share(a: SurveyedMap, b: SurveyedMap, pose: FloatArray, cell_m: float) -> float:
    """Return the share of the walls that run along each other within 0.25 m but not within 0.12 m."""
    forth = judge_poses(a.surface, b.probe, pose[np.newaxis], cell_m)
    back = judge_poses(b.surface, a.probe, se2.inverse(pose)[np.newaxis], cell_m)
    sharp, middle = (forth.parallel + back.parallel)[0].tolist()
    return 1.0 - sharp / middle if middle > 0.0 else 0.3


def _refined(walls: WallMap, probe: Probe, pose: FloatArray) -> FloatArray:
    """Return the pose of the probe's frame after refinement about the middle of the walls that meet."""
    placed = se2.transform_points(pose, probe.points)
    distance, _ = _field_at(walls, placed)
    near = distance < 0.5
    middle = np.array([*(probe.points[near].mean(axis=0) if near.any() else probe.points.mean(axis=0)), 0.0])
    start = se2.compose(pose, middle)
    refined = refine_each(walls, probe.points - middle[:2], start[np.newaxis], _SCALES_M)[0]
    return se2.compose(refined, se2.inverse(middle))


def _pull(walls: WallMap, probe: Probe, pose: FloatArray, middle: FloatArray, *, inverted: bool) -> _Pull:
    """Return how the probe's walls hold a small motion of map b about a middle (2,) in map a's frame.

    inverted: the probe is map a's, and pose that of grid a in b's frame; its points then move the other way.
    """
    placed = se2.transform_points(pose, probe.points)
    distance, slope = _field_at(walls, placed)
    normal, about = slope, placed - middle
    if inverted:
        T_a_b = se2.inverse(pose)
        cos, sin = np.cos(T_a_b[2]), np.sin(T_a_b[2])
        normal = -np.column_stack([cos * slope[:, 0] - sin * slope[:, 1], sin * slope[:, 0] + cos * slope[:, 1]])
        about = probe.points - middle
    weight = probe.lengths / (1.0 + (distance / _SCALE_M) ** 2) ** 2
    weight[distance >= 4.0 * _SCALE_M] = 0.0
    jacobian = np.column_stack([normal, normal[:, 1] * about[:, 0] - normal[:, 0] * about[:, 1]])
    matrix = (jacobian * weight[:, np.newaxis]).T @ jacobian
    gradients = np.zeros((int(probe.blocks.max()) + 1 if len(probe.blocks) else 0, 3))
    np.add.at(gradients, probe.blocks, jacobian * (weight * distance)[:, np.newaxis])
    return _Pull(matrix, gradients)


def _covariance(
    pulls: tuple[_Pull, _Pull], cell_m: float, lever: FloatArray, least: FloatArray, model: UncertaintyModel
) -> FloatArray:
    """Return the covariance (3, 3) of a pose's x, y, yaw, its origin being `lever` (2 or more) off the pulls' middle.

    least (3,): standard deviations about the middle that are there in any case.
    """
    inverse = np.linalg.inv(pulls[0].matrix + pulls[1].matrix + _HELD * np.eye(3))
    apart = pulls[0].gradients.T @ pulls[0].gradients + pulls[1].gradients.T @ pulls[1].gradients
    about_middle = model.spread * inverse @ apart @ inverse + model.cells * cell_m**2 * inverse + np.diag(least**2)
    onto = np.array([[1.0, 0.0, -lever[1]], [0.0, 1.0, lever[0]], [0.0, 0.0, 1.0]])
    return np.asarray(onto @ about_middle @ onto.T)


def _about(pose: FloatArray, middle: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the motion (3,) about a middle (2,) that takes the reference pose to a pose."""
    turn = float(se2.wrap_angle(pose[2] - reference[2]))
    kept = se2.transform_points(pose, se2.transform_points(se2.inverse(reference), middle))
    return np.array([*(kept - middle), turn])


def _moved(pose: FloatArray, middle: FloatArray, step: FloatArray) -> FloatArray:
    """Return a pose after a motion (3,) about a middle (2,)."""
    about = np.array([middle[0], middle[1], 0.0])
    moved = se2.compose(np.array([*(middle + step[:2]), step[2]]), se2.compose(se2.inverse(about), pose))
    return np.asarray(moved)


def _field_at(walls: WallMap, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the interpolated distance (N,) in m and its slope (N, 2) at points (N, 2) of the grid's frame."""
    rows, cols = walls.distances.shape
    place = points / walls.resolution_m - 0.5
    corner = np.floor(place).astype(np.int64)
    inside = (corner >= 0).all(axis=1) & (corner[:, 0] + 1 < cols) & (corner[:, 1] + 1 < rows)
    col, row = np.where(inside[:, np.newaxis], corner, 0).T
    u, v = (place - corner).T
    if rows < 2 or cols < 2:
        return np.full(len(points), FAR_M), np.zeros((len(points), 2))
    a, b, c, d = (walls.distances[row + i, col + j].astype(np.float64) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    low, high = a + u * (b - a), c + u * (d - c)
    slope = np.column_stack([(1.0 - v) * (b - a) + v * (d - c), high - low]) / walls.resolution_m
    distance = np.where(inside, low + v * (high - low), FAR_M)
    return distance, np.where(inside[:, np.newaxis], slope, 0.0)
