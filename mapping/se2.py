"""Planar rigid motions as arrays (..., 3) of x, y, yaw in metres and radians.

`T_a_b` is the pose of frame b in frame a; a point of b seen in a is `T_a_b * p_b`. All functions broadcast over leading
dimensions and return new arrays. Source of the exponential map: Sola, Deray, Atchuthan, "A micro Lie theory" (2018),
eq. 156-161. Single poses take a path without numpy, whose overhead is many times the work: the same arithmetic.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

IDENTITY: FloatArray = np.zeros(3)
IDENTITY.setflags(write=False)


def wrap_angle(angle_rad: ArrayLike) -> FloatArray:
    """Return the angle brought into [-pi, pi)."""
    wrapped: FloatArray = (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped


def compose(T_a_b: ArrayLike, T_b_c: ArrayLike) -> FloatArray:
    """Return T_a_c."""
    a, b = np.asarray(T_a_b, dtype=np.float64), np.asarray(T_b_c, dtype=np.float64)
    if a.ndim == b.ndim == 1:
        return np.array(_compose_one(a.tolist(), b.tolist()))
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + cos * b[..., 0] - sin * b[..., 1]
    y = a[..., 1] + sin * b[..., 0] + cos * b[..., 1]
    return np.stack([x, y, wrap_angle(a[..., 2] + b[..., 2])], axis=-1)


def inverse(T_a_b: ArrayLike) -> FloatArray:
    """Return T_b_a."""
    pose = np.asarray(T_a_b, dtype=np.float64)
    if pose.ndim == 1:
        return np.array(_inverse_one(pose.tolist()))
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = -cos * pose[..., 0] - sin * pose[..., 1]
    y = sin * pose[..., 0] - cos * pose[..., 1]
    return np.stack([x, y, wrap_angle(-pose[..., 2])], axis=-1)


def between(T_w_a: ArrayLike, T_w_b: ArrayLike) -> FloatArray:
    """Return T_a_b, the pose of b as a sees it."""
    a, b = np.asarray(T_w_a, dtype=np.float64), np.asarray(T_w_b, dtype=np.float64)
    if a.ndim == b.ndim == 1:
        return np.array(_compose_one(_inverse_one(a.tolist()), b.tolist()))
    return compose(inverse(a), b)


def transform_points(T_a_b: ArrayLike, points_b: ArrayLike) -> FloatArray:
    """Return the points (N, 2) of frame b in frame a; T_a_b is one pose (3,) or one a point (N, 3)."""
    pose, points = np.asarray(T_a_b, dtype=np.float64), np.asarray(points_b, dtype=np.float64)
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = pose[..., 0] + cos * points[..., 0] - sin * points[..., 1]
    y = pose[..., 1] + sin * points[..., 0] + cos * points[..., 1]
    return np.stack([x, y], axis=-1)


def exp(twist: ArrayLike) -> FloatArray:
    """Return the pose reached by moving for one unit of time at the body twist (..., 3) = (vx, vy, wz)."""
    v = np.asarray(twist, dtype=np.float64)
    w = v[..., 2]
    small = np.abs(w) < 1e-9
    safe = np.where(small, 1.0, w)
    a = np.where(small, 1.0 - w**2 / 6.0, np.sin(safe) / safe)
    b = np.where(small, w / 2.0, 2.0 * np.sin(safe / 2.0) ** 2 / safe)  # (1 - cos w) / w without cancellation
    return np.stack([a * v[..., 0] - b * v[..., 1], b * v[..., 0] + a * v[..., 1], wrap_angle(w)], axis=-1)


def log(pose: ArrayLike) -> FloatArray:
    """Return the body twist whose `exp` is the pose; yaw must be inside (-pi, pi)."""
    p = np.asarray(pose, dtype=np.float64)
    w = wrap_angle(p[..., 2])
    small = np.abs(w) < 1e-9
    safe = np.where(small, 1.0, w)
    half = safe / 2.0
    a = np.where(small, 1.0, half / np.tan(half))
    b = w / 2.0
    return np.stack([a * p[..., 0] + b * p[..., 1], -b * p[..., 0] + a * p[..., 1], w], axis=-1)


def to_matrix4(pose: ArrayLike) -> FloatArray:
    """Return the homogeneous 4x4 matrix of one planar pose (z = 0)."""
    x, y, yaw = np.asarray(pose, dtype=np.float64)
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    matrix[:2, 3] = x, y
    return matrix


def from_matrix4(matrix: ArrayLike) -> FloatArray:
    """Return (x, y, yaw) of a homogeneous 4x4 matrix; its z, roll and pitch are dropped."""
    m = np.asarray(matrix, dtype=np.float64)
    return np.array([m[0, 3], m[1, 3], np.arctan2(m[1, 0], m[0, 0])])


def _compose_one(a: list[float], b: list[float]) -> list[float]:
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return [a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], _wrap_one(a[2] + b[2])]


def _inverse_one(pose: list[float]) -> list[float]:
    x, y, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    return [-cos * x - sin * y, sin * x - cos * y, _wrap_one(-yaw)]


def _wrap_one(angle_rad: float) -> float:
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
