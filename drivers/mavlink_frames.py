"""Between ROS axes (x ahead, y left, z up) and MAVLink's (x ahead, y right, z down): the link's border.

Both are turned about x by half a turn against each other, in the body (FLU, FRD) as in the world. The map has no
compass: its x axis is MAVLink's local x axis ("forward" of MAV_FRAME_LOCAL_FRD), so y and yaw change their signs and
nothing is swapped, as an east-north-up world against north-east-down would need.
"""

from __future__ import annotations

import math

import numpy as np

from drivers.messages import FloatArray, LaserScan

SECTORS = 72
NOTHING_KNOWN_CM = 65535
_SECTOR_RAD = 2.0 * math.pi / SECTORS
_HALF_TURN = np.array([1.0, -1.0, -1.0])


def flipped_pose(pose: FloatArray) -> FloatArray:
    """Return a planar pose or twist (3,) of one side, x, y, yaw, as the other side has it."""
    flipped: FloatArray = np.asarray(pose, dtype=np.float64) * _HALF_TURN
    return flipped


def flipped_vector(vector: FloatArray) -> FloatArray:
    """Return a vector (3,) of one side, x, y, z, or turning speeds about them, as the other side has it."""
    flipped: FloatArray = np.asarray(vector, dtype=np.float64) * _HALF_TURN
    return flipped


def quaternion_frd(yaw_rad: float) -> tuple[float, float, float, float]:
    """Return MAVLink's quaternion (w, x, y, z) of a car on the ground with a ROS yaw."""
    return math.cos(yaw_rad / 2.0), 0.0, 0.0, -math.sin(yaw_rad / 2.0)


def yaw_from_frd(quaternion: tuple[float, float, float, float]) -> float:
    """Return the ROS yaw of MAVLink's quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return -math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def obstacle_sectors_cm(scan: LaserScan, T_base_laser: FloatArray) -> list[int]:
    """Return the nearest distance from base_link in each of 72 sectors, in cm; 65535 where nothing was measured.

    Sector k is centred on k * 5 deg, clockwise from straight ahead (OBSTACLE_DISTANCE in MAV_FRAME_BODY_FRD). A
    sector without a return is unknown, not free: the lidar cannot tell glass and black walls from nothing.
    T_base_laser: pose (3,) of the laser on the car.
    """
    x_m, y_m, yaw_rad = (float(value) for value in T_base_laser)
    angles, ranges = scan.angles_rad[scan.valid] + yaw_rad, scan.ranges_m[scan.valid]
    x, y = x_m + ranges * np.cos(angles), y_m + ranges * np.sin(angles)
    sector = np.round(np.arctan2(-y, x) / _SECTOR_RAD).astype(np.int64) % SECTORS
    nearest = np.full(SECTORS, np.inf)
    np.minimum.at(nearest, sector, np.hypot(x, y))
    known = np.isfinite(nearest)
    centimetres = np.full(SECTORS, NOTHING_KNOWN_CM, dtype=np.int64)
    # 0 would be "no sensor", and rounding down never makes an obstacle farther than it is.
    centimetres[known] = np.clip(np.floor(nearest[known] * 100.0), 1, NOTHING_KNOWN_CM - 1)
    found: list[int] = centimetres.tolist()
    return found
