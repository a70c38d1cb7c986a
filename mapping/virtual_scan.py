"""A depth image as the scan of a planar laser: the nearest obstacle in each direction, and how far the floor is free.

Obstacles are what stands in a band of heights above base_link. Directions are spread evenly over the image's columns.
In each of them ranges are counted in bins as wide as the noise, and the nearest bins with enough pixels are the beam:
a single pixel is never an obstacle. A direction without any measurement stays unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drivers.messages import DepthImage, LaserScan, Pinhole
from mapping.depth_bins import count_ranges, floor_ends, nearest_ranges
from mapping.depth_projection import CameraMount, Projection, pixel_rays, project
from mapping.depth_thinning import Thinning, thinned
from mapping.mount import Mount

FloatArray = NDArray[np.float64]

_FINEST_BIN_M = 0.02
_FLOOR_BIN_M = 0.25
_WHOLE_SIGMAS = 2.0
_FLOOR_GAP_M = 0.3  # holes of this length in the floor are the sensor's
_FLOOR_ROWS = 1.5  # and so many rows of the image may miss where rows lie far apart


@dataclass(frozen=True, slots=True)
class StereoNoise:
    """How wrong a stereo camera's depth z is: sigma = z^2 disparity_px / (f baseline_m), and a share of z on top.

    The defaults are a D435's: 0.08 px of its full image on textured walls, 1 % of bias. Its neighbours err alike, so
    that many pixels are no better than one.
    """

    disparity_px: float = 0.08
    baseline_m: float = 0.05
    bias: float = 0.01

    def sigma_m(self, depth_m: FloatArray, focal_px: float) -> FloatArray:
        """Return the standard deviation (N,) of depths (N,) in m."""
        random: FloatArray = depth_m**2 * (self.disparity_px / (focal_px * self.baseline_m))
        return np.asarray(np.hypot(random, self.bias * depth_m))


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """How a depth image becomes a scan.

    bottom_m, top_m: obstacles are what lies between these heights in base_link. pitch_error_rad: the floor may seem to
    rise or fall by this much, so that the band begins higher with range. pixels_per_beam: columns of the full image
    that make one beam. support: pixels, after thinning, that an obstacle needs in a beam. What is farther than 4 m is
    no obstacle on a map, but says that the way there is free.
    """

    bottom_m: float = 0.10
    top_m: float = 1.2
    pitch_error_rad: float = math.radians(1.5)
    pixels_per_beam: int = 4
    support: int = 6
    thinning: Thinning = field(default_factory=lambda: Thinning(farthest_m=6.0))
    noise: StereoNoise = field(default_factory=StereoNoise)

    def __post_init__(self) -> None:
        if not 0.0 < self.bottom_m < self.top_m:
            raise ValueError(f"obstacles from {self.bottom_m} m to {self.top_m} m: heights are not in order above 0")
        if self.pixels_per_beam < 1 or self.support < 1:
            raise ValueError(f"{self.pixels_per_beam} pixels a beam and {self.support} of support: both must be > 0")


@dataclass(frozen=True, slots=True, eq=False)
class VirtualScan:
    """Beams from a camera's place, parallel to the floor, seen at one instant.

    origin (2,): the camera in base_link, m. angles_rad (N,): directions in base_link, increasing. ranges_m (N,): the
    nearest obstacle, 0 where none was seen. sigma_m (N,): standard deviation of that range, or of free_to_m where there
    is none. free_from_m, free_to_m (N,): nothing stands between these ranges; nearer than the first the camera does not
    see what is low, and the second is 0 where nothing is known. Raises ValueError for other shapes.
    """

    stamp_ns: int
    origin: FloatArray
    angles_rad: FloatArray
    ranges_m: FloatArray
    sigma_m: FloatArray
    free_from_m: FloatArray
    free_to_m: FloatArray

    def __post_init__(self) -> None:
        shape = np.shape(self.angles_rad)
        for name in ("origin", "angles_rad", "ranges_m", "sigma_m", "free_from_m", "free_to_m"):
            array = np.array(getattr(self, name), dtype=np.float64)
            expected = (2,) if name == "origin" else shape
            if array.shape != expected or len(shape) != 1:
                raise ValueError(f"{name} has shape {array.shape}, expected {expected}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def mount(self) -> Mount:
        """Where the laser would sit that gives to_laser_scan()."""
        return Mount(np.array([self.origin[0], self.origin[1], 0.0]))

    def to_laser_scan(self, range_min_m: float = 0.3, range_max_m: float = 4.0) -> LaserScan:
        """Return the obstacles as a scan of a laser at `mount`, all samples taken at once."""
        return LaserScan(
            self.stamp_ns,
            self.angles_rad,
            self.ranges_m,
            np.zeros_like(self.ranges_m),
            range_min_m,
            range_max_m,
            frame_id="camera_scan",
        )


def scan_depth(
    image: DepthImage, mount: CameraMount, settings: ScanSettings, projection: Projection = project
) -> VirtualScan:
    """Return the scan of a depth image as the camera gave it."""
    points = projection(thinned(image, settings.thinning), mount)
    return scan_points(points, image.stamp_ns, image.camera, mount, settings)


def scan_points(
    points: FloatArray, stamp_ns: int, camera: Pinhole, mount: CameraMount, settings: ScanSettings
) -> VirtualScan:
    """Return the scan of points (N, 3) in base_link, which a camera (with its full image) saw from its mount."""
    tangents = _beam_tangents(camera, settings.pixels_per_beam)
    ranges, floor = _count(points, tangents, camera, mount, settings)
    row_gap = _FLOOR_ROWS * settings.thinning.decimation / (camera.fy * max(mount.z_m, 0.05))
    ends = floor_ends(floor, _FLOOR_BIN_M, _FLOOR_GAP_M, row_gap)
    free_to = _free_up_to(ranges, ends, row_gap)
    per_depth = np.hypot(1.0, tangents)  # range for a depth of 1
    ranges = np.where(_is_whole(ranges / per_depth, camera, settings), ranges, 0.0)
    known = np.where(ranges > 0.0, ranges, free_to)
    return VirtualScan(
        stamp_ns,
        origin=np.array([mount.x_m, mount.y_m]),
        angles_rad=mount.yaw_rad + np.arctan(tangents),
        ranges_m=ranges,
        sigma_m=settings.noise.sigma_m(known / per_depth, camera.fx) * per_depth,
        free_from_m=np.maximum(
            _low_things_from(camera, mount, tangents, settings.bottom_m),
            np.maximum(settings.thinning.nearest_m, _matched_from(camera, tangents, settings) * per_depth),
        ),
        free_to_m=free_to,
    )


def _count(
    points: FloatArray, tangents: FloatArray, camera: Pinhole, mount: CameraMount, settings: ScanSettings
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return the range (N,) of the nearest obstacle in each beam, 0 where none, and the floor's counts (N, bins)."""
    bin_of_mm, bins = _range_bins(settings, camera.fx)
    per_tangent = camera.fx / settings.pixels_per_beam
    counts = np.zeros((len(tangents), bins), np.int32)
    sums = np.zeros((len(tangents), bins))
    floor = np.zeros((len(tangents), math.ceil(settings.thinning.farthest_m * 2.0 / _FLOOR_BIN_M)), np.int32)
    count_ranges(
        points,
        np.array([mount.x_m, mount.y_m, math.cos(mount.yaw_rad), math.sin(mount.yaw_rad)]),
        np.array([tangents[0] - 0.5 / per_tangent, per_tangent]),
        np.array([settings.bottom_m, math.tan(settings.pitch_error_rad), settings.top_m]),
        bin_of_mm,
        _FLOOR_BIN_M,
        counts,
        sums,
        floor,
    )
    return nearest_ranges(counts, sums, settings.support), floor


def _matched_from(camera: Pinhole, tangents: FloatArray, settings: ScanSettings) -> FloatArray:
    """Return the depth (N,) from which on both imagers see all of a beam: nearer, the right one's image has ended."""
    first_column = camera.cx - camera.fx * tangents - 0.5 * (settings.pixels_per_beam - 1)
    return np.asarray(camera.fx * settings.noise.baseline_m / np.maximum(first_column, 0.1))


def _is_whole(depths_m: FloatArray, camera: Pinhole, settings: ScanSettings) -> NDArray[np.bool_]:
    """Return for obstacles at depths (N,) whether all of their noise is within reach.

    Of a wall near or beyond the last depth that is kept only the nearest measurements are: it seems to stand there,
    wherever it is, and a car that is located by it seems to stand still.
    """
    sigma = settings.noise.sigma_m(depths_m, camera.fx)
    return np.asarray(depths_m + _WHOLE_SIGMAS * sigma <= settings.thinning.farthest_m)


def _free_up_to(ranges_m: FloatArray, floor_to_m: FloatArray, row_gap: float) -> FloatArray:
    """Return up to where each beam (N,) is free: the obstacle, or where the floor ends for no visible reason.

    A gap between floor and obstacle is something that the camera cannot measure; the obstacle is seen above it.
    """
    reach = floor_to_m + _FLOOR_BIN_M + _FLOOR_GAP_M + row_gap * ranges_m**2
    to_obstacle = (ranges_m > 0.0) & ((floor_to_m == 0.0) | (reach >= ranges_m))
    return np.where(to_obstacle, ranges_m, floor_to_m)


def _low_things_from(camera: Pinhole, mount: CameraMount, tangents: FloatArray, bottom_m: float) -> FloatArray:
    """Return the range (N,) from which on the image shows heights down to bottom_m in each beam; inf: nowhere."""
    last_row = Pinhole(camera.width, 1, camera.fx, camera.fy, camera.cx, camera.cy - (camera.height - 1))
    rays = pixel_rays(last_row, replace(mount, yaw_rad=0.0))[0]
    ahead = rays[::-1][rays[::-1, 0] > 0.0]  # from right to left, as the beams
    if len(ahead) == 0:
        return np.zeros_like(tangents)  # the image ends below the car
    fall = -ahead[:, 2] / np.hypot(ahead[:, 0], ahead[:, 1])
    falls = np.interp(tangents, ahead[:, 1] / ahead[:, 0], fall)
    down_m = max(mount.z_m - bottom_m, 0.0)
    return np.where(falls > 0.0, down_m / np.maximum(falls, 1e-9), 0.0 if down_m == 0.0 else np.inf)


def _beam_tangents(camera: Pinhole, pixels_per_beam: int) -> FloatArray:
    """Return the tangents (N,) of the beams' angles to the camera's axis, increasing to the left."""
    count = camera.width // pixels_per_beam
    middles = (np.arange(count)[::-1] + 0.5) * pixels_per_beam - 0.5
    return np.asarray((camera.cx - middles) / camera.fx, np.float64)


@lru_cache(maxsize=4)
def _range_bins(settings: ScanSettings, focal_px: float) -> tuple[NDArray[np.int32], int]:
    """Return the bin of each range in mm, and the number of bins: as wide as sigma, but not finer than 2 cm."""
    farthest = 2.0 * settings.thinning.farthest_m  # slanted lines of sight are longer than their depth
    edges = [0.0]
    while edges[-1] < farthest:
        sigma = float(settings.noise.sigma_m(np.array([edges[-1]]), focal_px)[0])
        edges.append(edges[-1] + max(_FINEST_BIN_M, sigma))
    middles = (np.arange(math.ceil(farthest * 1000.0)) + 0.5) * 1e-3
    bins = np.searchsorted(np.array(edges), middles, side="right") - 1
    return bins.astype(np.int32), len(edges)
