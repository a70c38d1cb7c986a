"""Where do two whole maps fit on each other? Correlation of their wall and free layers over all rotations and shifts.

No correspondences are needed. For each rotation of map b the score of every shift at once is one product of spectra:

    S = sum O_b O_a - w_c (O_b F_a + F_b O_a) + w_f F_b F_a

with O the share of wall and F the share of free space of the coarse cells: walls on walls count for a place, walls in
free space against it. Cells next to walls do not count as free: a wall that is off by one cell is no contradiction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import fft

from mapping import se2
from mapping.wall_map import FREE, WALL, WallMap

FloatArray = NDArray[np.float64]
Layer = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
_CONFLICT = 1.0  # w_c
_COMMON_FREE = 0.05  # w_f: large wholes need much of it, small overlaps little
_BLUR_CELLS = 0.8
_WALL_SHARE, _CLEAR_CELLS = 0.2, 1.9  # free cells count farther than this from a cell with that much wall
_CLEARED = 4  # cells around a peak that no second peak may lie in


@dataclass(frozen=True, slots=True, eq=False)
class Layers:
    """Shares 0..1 of wall and of free space (rows, cols) in cells of cell_m, from the grid's lower-left corner."""

    wall: Layer
    free: Layer
    cell_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Shifts:
    """Candidate poses (K, 3) of grid b in grid a's frame, best first, and their scores (K,)."""

    poses: FloatArray
    scores: FloatArray


def coarse_layers(walls: WallMap, cell_m: float) -> Layers:
    """Return the layers at a coarser cell; a wall one cell thick fills its coarse cell."""
    factor = walls.resolution_m / cell_m
    occupied = _pooled(walls.states == WALL, factor)
    occupied = np.minimum(occupied / np.float32(factor), np.float32(1.0))
    free = _pooled(walls.states == FREE, factor)
    solid = (occupied < _WALL_SHARE).astype(np.uint8)
    if not solid.all():
        free[cv2.distanceTransform(solid, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= _CLEAR_CELLS] = 0.0
    return Layers(occupied, free, cell_m)


def correlate(a: Layers, b: Layers, *, turns: int, peaks_per_turn: int) -> Shifts:
    """Return the best shifts of every one of `turns` rotations of b, an even number, all in one list.

    Both must have the same cell_m. Memory grows with the area of both, time with turns times that.
    """
    side = math.ceil(math.hypot(*b.wall.shape)) + 2
    rows, cols = a.wall.shape
    shape = (fft.next_fast_len(rows + side, real=True), fft.next_fast_len(cols + side, real=True))
    spectrum_wall = fft.rfft2(cv2.GaussianBlur(a.wall, (0, 0), _BLUR_CELLS), shape)
    spectrum_free = fft.rfft2(a.free, shape)
    against_wall = spectrum_wall - np.float32(_CONFLICT) * spectrum_free
    against_free = np.float32(_COMMON_FREE) * spectrum_free - np.float32(_CONFLICT) * spectrum_wall
    middle_b = (np.array(b.wall.shape[::-1]) - 1.0) / 2.0
    middle = np.full(2, (side - 1) / 2.0)
    poses: list[list[float]] = []
    scores: list[float] = []
    for turn in np.arange(turns // 2) * (2.0 * np.pi / turns):
        cos, sin = math.cos(turn), math.sin(turn)
        rotation = np.array([[cos, -sin], [sin, cos]])
        onto = np.column_stack([rotation, middle - rotation @ middle_b])
        wall_b, free_b = (
            _spectrum_of_corner(
                np.asarray(cv2.warpAffine(layer, onto, (side, side), flags=cv2.INTER_LINEAR), np.float32), shape
            )
            for layer in (b.wall, b.free)
        )
        # Turned by half a turn, the canvas is read backwards: its correlation is the convolution with what is there.
        products = _products(against_wall, against_free, wall_b, free_b)
        halves = ((turn, rotation, 0, products[0]), (turn + np.pi, -rotation, side - 1, products[1]))
        for angle, turned, ahead, product in halves:
            corner = middle - turned @ (middle_b + 0.5) + 0.5
            for score, row, col in _peaks(fft.irfft2(product, shape, overwrite_x=True), peaks_per_turn):
                shift = np.array([_unwrapped(col - ahead, cols, shape[1]), _unwrapped(row - ahead, rows, shape[0])])
                poses.append([*((corner + shift) * a.cell_m).tolist(), float(se2.wrap_angle(angle))])
                scores.append(score)
    order = np.argsort(-np.array(scores), kind="stable")
    return Shifts(np.array(poses)[order], np.array(scores)[order])


def _spectrum_of_corner(layer: Layer, shape: tuple[int, int]) -> Spectrum:
    """Return the spectrum of a layer that is padded to a shape; the rows of zeros are not transformed one by one."""
    return np.asarray(fft.fft(fft.rfft(layer, shape[1], axis=1), shape[0], axis=0))


@njit(cache=True, nogil=True)
def _products(wall_a: Spectrum, free_a: Spectrum, wall_b: Spectrum, free_b: Spectrum) -> tuple[Spectrum, Spectrum]:
    """Return wall_a wall_b* + free_a free_b*, and the same with b's spectra themselves, in one pass."""
    correlated, convolved = np.empty_like(wall_b), np.empty_like(wall_b)
    for row in range(wall_b.shape[0]):
        for col in range(wall_b.shape[1]):
            w, f = wall_b[row, col], free_b[row, col]
            correlated[row, col] = wall_a[row, col] * w.conjugate() + free_a[row, col] * f.conjugate()
            convolved[row, col] = wall_a[row, col] * w + free_a[row, col] * f
    return correlated, convolved


def _unwrapped(shift: int, extent: int, period: int) -> int:
    """Return a cyclic shift as the one from -(period - extent) to extent."""
    return (shift + period - extent) % period - (period - extent)


def _pooled(mask: NDArray[np.bool_], factor: float) -> Layer:
    """Return the share of set cells in cells 1 / factor times as large; what sticks out is unset."""
    rows, cols = (max(1, math.ceil(count * factor - 1e-9)) for count in mask.shape)
    padded = np.zeros((max(round(rows / factor), mask.shape[0]), max(round(cols / factor), mask.shape[1])), np.uint8)
    np.multiply(mask, np.uint8(255), out=padded[: mask.shape[0], : mask.shape[1]], casting="unsafe")
    pooled = cv2.resize(padded, (cols, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(pooled.astype(np.float32) / np.float32(255.0))


def _peaks(surface: Layer, count: int) -> list[tuple[float, int, int]]:
    """Return score, row and column of the highest cells that are not next to each other; the surface is used up."""
    found = []
    highest = surface.max(axis=1)
    for _ in range(count):
        row = int(np.argmax(highest))
        col = int(np.argmax(surface[row]))
        found.append((float(surface[row, col]), row, col))
        near = np.s_[max(0, row - _CLEARED) : row + _CLEARED + 1]
        surface[near, max(0, col - _CLEARED) : col + _CLEARED + 1] = -np.inf
        highest[near] = surface[near].max(axis=1)
    return found
