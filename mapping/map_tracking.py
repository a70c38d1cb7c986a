"""Keeping a place on a saved map: every scan refines the pose that the odometry predicts, and a lost track is said.

A Kalman filter on the pose whose measurement is the Gauss-Newton fit on the map's distance field, with the prediction
as prior: along a bare corridor the odometry leads, across it the walls do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.map_matching import refine
from mapping.place_evidence import Evidence, judge
from mapping.reference_map import ReferenceMap
from mapping.relocalisation import Located, RelocalisationSettings, Relocaliser
from mapping.surface import facings_of

FloatArray = NDArray[np.float64]

_SCALES_M = (0.2, 0.15, 0.1, 0.1)
_MOST_POINTS = 360
_LEAST_SHARE = 0.2  # of the points on walls that the map is taken to know at the least


@dataclass(frozen=True, slots=True)
class TrackingSettings:
    """When a scan fits, and when the track is lost.

    drift_m_per_m, drift_rad_per_m, drift_rad_per_rad: standard deviations of the odometry. floor_m, floor_rad: of what
    the map itself may be off, added to what is reported. step_m, step_rad: driving between two fits: scans of one place
    err alike, and a robot that stands would otherwise follow what moves in front of it. min_hits, max_contradiction:
    shares of the points where the map knows something; min_known of them are needed to judge. gate_m, gate_rad: a
    correction beyond that and three standard deviations is not believed. The track is lost after lost_m or lost_rad of
    driving without a scan that fits.
    """

    drift_m_per_m: float = 0.05
    drift_rad_per_m: float = 0.02
    drift_rad_per_rad: float = 0.03
    floor_m: float = 0.02
    floor_rad: float = 0.005
    step_m: float = 0.05
    step_rad: float = 0.05
    min_hits: float = 0.6
    max_contradiction: float = 0.3
    min_known: int = 20
    gate_m: float = 0.2
    gate_rad: float = 0.08
    lost_m: float = 3.0
    lost_rad: float = 6.0


class MapTracker:
    """Follows the body from a place that was found; sensor (2,): the laser's place on the body."""

    def __init__(
        self,
        reference: ReferenceMap,
        found: Located,
        settings: TrackingSettings,
        sensor: FloatArray = se2.IDENTITY[:2],
    ) -> None:
        self.lost = False
        self.reason = found.reason
        self._map = reference
        self._settings = settings
        self._sensor = np.array(sensor, dtype=np.float64)
        self._pose = se2.compose(se2.inverse(reference.walls.T_map_grid), found.T_map_base)  # in the grid's frame
        self._covariance = _turned(found.covariance, -reference.walls.T_map_grid[2])
        self._T_odom_base = se2.compose(se2.inverse(found.T_map_odom), found.T_map_base)
        self._unseen = np.zeros(2)  # metres and radians since a scan fitted
        self._moved = np.zeros(2)  # and since one was tried
        self._last = (found.score, False)

    def add(self, stamp_ns: int, points_body: FloatArray, T_odom_base: FloatArray) -> Located | None:
        """Take in a scan (N, 2) in the body frame made at T_odom_base (3,); return the place, None once it is lost.

        Where the scan does not fit, the place is what the odometry makes of the last one, and the reason says so.
        """
        if self.lost:
            return None
        self._predict(np.array(T_odom_base, dtype=np.float64))
        if self._moved[0] < self._settings.step_m and self._moved[1] < self._settings.step_rad:
            return self._place(stamp_ns)
        self._moved[:] = 0.0
        step = -(-len(points_body) // _MOST_POINTS) if len(points_body) else 1
        points = np.ascontiguousarray(points_body[::step], dtype=np.float64)
        facings_rad = facings_of(points, self._sensor)
        origins = np.broadcast_to(self._sensor, points.shape).copy()
        trust = _trust(judge(self._map.faces, points, facings_rad, origins, self._pose))
        prior = np.asarray(np.linalg.inv(trust * self._covariance), dtype=np.float64)
        fit = refine(self._map.faces, points, facings_rad, self._pose, scales_m=_SCALES_M, prior=prior)
        evidence = judge(self._map.faces, points, facings_rad, origins, fit.pose)
        objection = self._objection(fit.pose, evidence.known, evidence.hit_share, evidence.contradiction)
        if objection is None:
            self._pose = fit.pose
            self._covariance = np.asarray(np.linalg.inv(trust * fit.information), dtype=np.float64)
            self._unseen[:] = 0.0
            self.reason = f"{evidence.hit_share:.0%} of {evidence.known} points on walls"
        else:
            self.reason = f"by odometry: {objection}"
            if self._unseen[0] > self._settings.lost_m or self._unseen[1] > self._settings.lost_rad:
                self.lost = True
                self.reason = f"lost after {self._unseen[0]:.1f} m without a scan that fits: {objection}"
                return None
        self._last = (evidence.hit_share, objection is not None)
        return self._place(stamp_ns)

    def _place(self, stamp_ns: int) -> Located:
        """Return the present pose in the map's frame."""
        T_map_base = se2.compose(self._map.walls.T_map_grid, self._pose)
        T_map_odom = se2.compose(T_map_base, se2.inverse(self._T_odom_base))
        floor = np.diag([self._settings.floor_m, self._settings.floor_m, self._settings.floor_rad]) ** 2
        covariance = _turned(self._covariance, self._map.walls.T_map_grid[2]) + floor
        score, by_odometry = self._last
        return Located(
            stamp_ns,
            T_map_base,
            T_map_odom,
            covariance,
            score,
            self.reason,
            by_odometry=by_odometry,
        )

    def _predict(self, T_odom_base: FloatArray) -> None:
        """Move pose and covariance by what the odometry says."""
        rule = self._settings
        moved = se2.between(self._T_odom_base, T_odom_base)
        self._T_odom_base = T_odom_base
        before = self._pose
        self._pose = se2.compose(before, moved)
        distance_m, turned_rad = float(np.hypot(moved[0], moved[1])), abs(float(moved[2]))
        self._unseen += (distance_m, turned_rad)
        self._moved += (distance_m, turned_rad)
        across = self._pose[:2] - before[:2]
        motion = np.array([[1.0, 0.0, -across[1]], [0.0, 1.0, across[0]], [0.0, 0.0, 1.0]])
        drift_m = rule.drift_m_per_m * distance_m
        drift_rad = np.hypot(rule.drift_rad_per_m * distance_m, rule.drift_rad_per_rad * turned_rad)
        self._covariance = motion @ self._covariance @ motion.T + np.diag([drift_m**2, drift_m**2, drift_rad**2])

    def _objection(self, pose: FloatArray, known: int, hits: float, contradiction: float) -> str | None:
        """Return why a fit is not believed, None if it is."""
        rule = self._settings
        if known < rule.min_known:
            return f"the map knows something about {known} points only"
        if hits < rule.min_hits or contradiction > rule.max_contradiction:
            return f"{hits:.0%} of {known} points on walls, {contradiction:.0%} against the map"
        away = np.array([*(pose[:2] - self._pose[:2]), se2.wrap_angle(pose[2] - self._pose[2])])
        far = np.hypot(away[0], away[1]) > max(rule.gate_m, 3.0 * np.sqrt(np.trace(self._covariance[:2, :2])))
        if far or abs(away[2]) > max(rule.gate_rad, 3.0 * np.sqrt(self._covariance[2, 2])):
            return f"the scan wants a jump of {np.hypot(away[0], away[1]):.2f} m, {np.degrees(away[2]):.0f} deg"
        return None


class MapLocaliser:
    """Finds the place on a map, keeps it, and looks for it anew when it is lost: what a run on a saved map needs.

    `reason` says why there is no place, or what the last one rests on; `losses` counts how often it was lost.
    """

    def __init__(
        self,
        reference: ReferenceMap,
        sensor: FloatArray = se2.IDENTITY[:2],
        relocalisation: RelocalisationSettings | None = None,
        tracking: TrackingSettings | None = None,
    ) -> None:
        self.losses = 0
        self.reason = "no scan yet"
        self._map = reference
        self._sensor = np.array(sensor, dtype=np.float64)
        self._relocalisation = relocalisation or RelocalisationSettings()
        self._tracking = tracking or TrackingSettings()
        self._relocaliser = Relocaliser(reference, self._relocalisation, self._sensor)
        self._tracker: MapTracker | None = None

    def add(self, stamp_ns: int, points_body: FloatArray, T_odom_base: FloatArray) -> Located | None:
        """Take in a scan (N, 2) in the body frame made at T_odom_base (3,); return where it was, None if not known."""
        if self._tracker is not None:
            place = self._tracker.add(stamp_ns, points_body, T_odom_base)
            self.reason = self._tracker.reason
            if place is None:
                self.losses += 1
                self._tracker = None
                self._relocaliser = Relocaliser(self._map, self._relocalisation, self._sensor)
            return place
        found = self._relocaliser.add(stamp_ns, points_body, T_odom_base)
        self.reason = self._relocaliser.reason
        if found is not None:
            self._tracker = MapTracker(self._map, found, self._tracking, self._sensor)
        return found


def _trust(expected: Evidence) -> float:
    """Return how much the points of a scan count, 0..1: those of one or two walls err alike, and so do the next scan's.

    A wall of the map lies up to half a cell beside the true one. Where the map knows all that is seen, many walls make
    up for that; where it knows little, the odometry knows better. expected: what the points say where it predicts them.
    """
    return float(max(expected.hits / max(expected.points, 1), _LEAST_SHARE) ** 2)


def _turned(covariance: FloatArray, turn_rad: float) -> FloatArray:
    """Return a covariance (3, 3) of x, y, yaw in a frame in which the present one is turned by that."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T)
