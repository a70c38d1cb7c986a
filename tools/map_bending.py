"""Simulated deformation: the scans of a real log moved by a smooth random field before they are drawn as a map.

Two runs through one building never bend alike, two windows of one corrected log do. With a field of its own for each
map, what is left of their agreement is what two runs would have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.errors import FusionError
from fusion.evaluation import common_free_points
from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.metrics import align_points
from mapping.sensor_models import LidarModel
from tools.log_windows import PosedScans, ScanNumbers, map_of
from tools.pair_files import RIGHT_M, PairTruth

FloatArray = NDArray[np.float64]
BENT_RIGHT_DEG = 4.0
_WAVES, _WAVELENGTHS_M = 6, (12.0, 60.0)
_RMS_M, _MILD_SHARE = (0.05, 0.8), 0.3
_SHORT_OF_REACH, _BEYOND_REACH = 0.999, 1.02  # a return stays a return where the field stretches its beam, none none
_TRUTH_CELL_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class BendingField:
    """A displacement of the plane, the sum of plane waves: wave vectors (W, 2) in rad/m, phases and amplitudes (W, 2).

    A wave has a phase and an amplitude in m for x and another for y.
    """

    waves: FloatArray
    phases: FloatArray
    amplitudes_m: FloatArray

    def bend(self, points: FloatArray) -> FloatArray:
        """Return points (N, 2) in m where the field moves them."""
        moved = np.array(points, dtype=np.float64)
        for wave, phase, amplitude_m in zip(self.waves, self.phases, self.amplitudes_m, strict=True):
            moved += amplitude_m * np.sin((points @ wave)[:, np.newaxis] + phase)
        return moved


def draw_field(random: np.random.Generator, rms_m: float) -> BendingField:
    """Return a random field of six waves, 12 to 60 m long, that moves a point by rms_m on average over the plane."""
    lengths_m = random.uniform(*_WAVELENGTHS_M, _WAVES)
    directions = random.uniform(0.0, 2.0 * np.pi, _WAVES)
    waves = (2.0 * np.pi / lengths_m)[:, np.newaxis] * np.column_stack([np.cos(directions), np.sin(directions)])
    phases = random.uniform(0.0, 2.0 * np.pi, (_WAVES, 2))
    amplitudes = random.standard_normal((_WAVES, 2))
    return BendingField(waves, phases, amplitudes * rms_m / np.sqrt((amplitudes**2).sum() / 2.0))


def draw_field_pair(
    random: np.random.Generator, bend_m: tuple[float, float] | None = None
) -> tuple[BendingField, BendingField]:
    """Return the fields of two maps: 0.05 to 0.8 m rms each, in every second pair 0.3 of that.

    bend_m: another range of the rms, of all pairs alike.
    """
    rms_m = random.uniform(*(bend_m or _RMS_M), 2)
    if random.random() < 0.5 and bend_m is None:
        rms_m *= _MILD_SHARE
    return draw_field(random, float(rms_m[0])), draw_field(random, float(rms_m[1]))


def bent_map_of(
    scans: PosedScans, numbers: ScanNumbers, resolution_m: float, T_map_log: FloatArray, field: BendingField
) -> OccupancyGrid:
    """Return the grid of some scans whose origins and end points a field of the log's frame has moved.

    It is drawn in a frame in which the log's frame has the pose T_map_log (3,).
    """
    builder = GridBuilder(resolution_m, LidarModel(max_range_m=scans.reach_m, noise_fraction=0.0))
    for number in numbers.tolist():
        points = scans.points[number]
        ranges_m = np.hypot(points[:, 0], points[:, 1])
        far = ranges_m > scans.reach_m
        shortened = np.where(far, _BEYOND_REACH * scans.reach_m / np.maximum(ranges_m, 1e-9), 1.0)
        pose = scans.poses[number]
        ends = se2.transform_points(pose, points * shortened[:, np.newaxis])
        moved = se2.transform_points(T_map_log, field.bend(np.vstack([pose[:2], ends])))
        rays = moved[1:] - moved[0]
        lengths_m = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-9)
        kept_m = np.where(
            far,
            np.maximum(lengths_m, _BEYOND_REACH * scans.reach_m),
            np.minimum(lengths_m, _SHORT_OF_REACH * scans.reach_m),
        )
        builder.add_scan(moved[0], moved[0] + rays * (kept_m / lengths_m)[:, np.newaxis])
    return builder.grid()


def bent_truth(
    scans: tuple[PosedScans, PosedScans],
    numbers: tuple[ScanNumbers, ScanNumbers],
    fields: tuple[BendingField, BendingField],
    T_b_log: FloatArray,
) -> PairTruth | None:
    """Return the rigid motion that fits points best which both fields have moved; None where the maps share none.

    The points are common free space of the two maps unbent; map a's frame is the log's. What no rigid motion can undo
    is added to the distance that counts as right.
    """
    straight = [map_of(each, some, _TRUTH_CELL_M, se2.IDENTITY) for each, some in zip(scans, numbers, strict=True)]
    try:
        points = common_free_points(straight[0], straight[1], se2.IDENTITY)
    except FusionError:
        return None
    points_a, points_b = fields[0].bend(points), se2.transform_points(T_b_log, fields[1].bend(points))
    T_a_b = align_points(points_a, points_b)
    apart = se2.transform_points(T_a_b, points_b) - points_a
    residual_m = float(np.sqrt((apart**2).sum(axis=1).mean()))
    return PairTruth(T_a_b, points_a, points_b, RIGHT_M + residual_m, BENT_RIGHT_DEG)
