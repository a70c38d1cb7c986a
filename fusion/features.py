"""Stage 2 of Algorithm 3: keypoints and descriptors: KAZE with SIFT (thesis 3.2, 3.3), or others of table 4.2."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.errors import FusionError
from fusion.free_space import Layer

FloatArray = NDArray[np.float64]
Descriptors = NDArray[np.float32] | NDArray[np.uint8]

_THRESHOLD, _OCTAVES, _SUBLEVELS = 1e-4, 3, 4  # MATLAB's defaults, which the thesis used; AKAZE has the same levels
STRONGEST = 5000  # matching costs the product of both maps' numbers
_QUALITY, _APART_PX, _BLOCK_PX, _HARRIS_K = 0.01, 1.0, 3, 0.04  # of the corner detectors, MATLAB's too
_CORNER_PX = 8.0  # a corner has no size of its own, but descriptors need one
_CENTROID_PX = 15  # radius of ORB's patch
_SIFT_PX, _ORB_PX, _ORB_STEP = 4.8, 31.0, 1.2  # sizes in each descriptor's octave 0, and the factor between ORB's
_MARGIN = 16  # keypoints need surroundings: free space that touches the image's edge would have none
_WIDE_MARGIN = 40  # ORB and BRISK leave out what is this near the edge
_AKAZE_LEAST = (40 << _OCTAVES, 80 << _OCTAVES)  # rows, cols: in smaller images AKAZE has fewer levels than KAZE

# Each is made for the most keypoints that are wanted; those that find all heed it no further.
_WITH_DESCRIPTOR: MappingProxyType[str, Callable[[int], cv2.Feature2D]] = MappingProxyType(
    {
        "kaze": lambda _: cv2.KAZE.create(False, False, _THRESHOLD, _OCTAVES, _SUBLEVELS),
        "akaze": lambda _: cv2.AKAZE.create(nOctaves=_OCTAVES, nOctaveLayers=_SUBLEVELS),
        "sift": lambda _: cv2.SIFT.create(),
        "orb": cv2.ORB.create,
        "brisk": lambda _: cv2.BRISK.create(),
    }
)
_WITHOUT: MappingProxyType[str, Callable[[int], cv2.Feature2D]] = MappingProxyType(
    {
        "harris": lambda most: cv2.GFTTDetector.create(most, _QUALITY, _APART_PX, _BLOCK_PX, True, _HARRIS_K),
        "shi-tomasi": lambda most: cv2.GFTTDetector.create(most, _QUALITY, _APART_PX, _BLOCK_PX, False),
        "fast": lambda _: cv2.FastFeatureDetector.create(),
        "agast": lambda _: cv2.AgastFeatureDetector.create(),
        "mser": lambda _: cv2.MSER.create(),
    }
)
_OF_BITS = ("akaze", "orb", "brisk")
_NOT_IN_WHEELS = ("surf", "freak", "brief", "daisy", "star")
DESCRIPTORS = tuple(_WITH_DESCRIPTOR)
DETECTORS = (*_WITH_DESCRIPTOR, *_WITHOUT)


def _check_name(what: str, name: str, known: Sequence[str]) -> None:
    if name in _NOT_IN_WHEELS:
        raise FusionError(f"{what} {name}: it is not in OpenCV's wheels, so not here: take one of {', '.join(known)}")
    if name not in known:
        raise FusionError(f"{what} {name!r}: unknown: take one of {', '.join(known)}")


@dataclass(frozen=True, slots=True)
class FeatureMethod:
    """A detector and a descriptor by name, see DETECTORS and DESCRIPTORS; raises FusionError for what cannot be.

    Without a descriptor it is the detector's own, and SIFT's for KAZE (section 3.3) and for those that have none.
    """

    detector: str = "kaze"
    descriptor: str = ""
    name: str = field(init=False)

    def __post_init__(self) -> None:
        _check_name("detector", self.detector, DETECTORS)
        own = self.detector if self.detector in _WITH_DESCRIPTOR and self.detector != "kaze" else "sift"
        object.__setattr__(self, "descriptor", self.descriptor or own)
        object.__setattr__(self, "name", f"{self.detector}+{self.descriptor}")
        _check_name("descriptor", self.descriptor, DESCRIPTORS)
        takes = {"kaze": ("kaze",), "akaze": ("kaze", "akaze")}.get(self.descriptor, DETECTORS)
        if self.detector not in takes:
            raise FusionError(
                f"descriptor {self.descriptor}: describes keypoints of {' and '.join(takes)} only, "
                f"not of {self.detector}: take sift, orb or brisk"
            )


KAZE_SIFT = FeatureMethod("kaze", "sift")


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """points (N, 2) as x, y in cells of the layer, (0.5, 0.5) the centre of the first; descriptors (N, K).

    float32 descriptors differ by their SSD, uint8 ones are K bytes of bits.
    """

    points: FloatArray
    descriptors: Descriptors


def detect_features(
    layer: Layer, method: FeatureMethod = KAZE_SIFT, outside: int = 0, strongest: int | None = STRONGEST
) -> Features:
    """Find the strongest keypoints of a layer, None all, and describe them; outside is the layer's value around it.

    KAZE's are extrema of the determinant of the Hessian (3.10) in its scale space (3.3-3.9). Keypoints must come from
    `detectAndCompute`: `detect` alone leaves every orientation of KAZE's at 0, and then descriptors of a turned map
    match nothing. A keypoint whose surroundings do not hold a descriptor is left out.
    """
    margin = _WIDE_MARGIN if {"orb", "brisk"} & {method.detector, method.descriptor} else _MARGIN
    if layer.any():
        image = _framed(layer, margin, outside, method)
        keypoints, descriptors = _keypoints(image, method, image.size if strongest is None else strongest)
        if method.descriptor != method.detector and keypoints:
            keypoints = _prepared(image, keypoints, method)
            keypoints, descriptors = _WITH_DESCRIPTOR[method.descriptor](STRONGEST).compute(image, keypoints)
        if len(keypoints):
            points = np.array([keypoint.pt for keypoint in keypoints], dtype=np.float64)
            # OpenCV counts from the centre of the first pixel.
            points += 0.5 - margin
            if method.descriptor in _OF_BITS:
                return Features(points, np.asarray(descriptors, dtype=np.uint8))
            return Features(points, np.asarray(descriptors, dtype=np.float32))
    return Features(np.empty((0, 2)), np.empty((0, 1), np.float32))


def count_keypoints(layer: Layer, detector: str, outside: int = 0) -> int:
    """Return how many keypoints a detector finds in all, also those that no descriptor could describe."""
    if not layer.any():
        return 0
    method = FeatureMethod(detector)
    image = _framed(layer, _WIDE_MARGIN, outside, method)
    return len(({**_WITHOUT, **_WITH_DESCRIPTOR})[detector](image.size).detect(image))


def _framed(layer: Layer, margin: int, outside: int, method: FeatureMethod) -> Layer:
    """Return the layer with a margin around it; where AKAZE describes KAZE's keypoints, large enough for its levels."""
    least = _AKAZE_LEAST if (method.detector, method.descriptor) == ("kaze", "akaze") else (0, 0)
    below, right = (max(margin, least[axis] - layer.shape[axis] - margin) for axis in (0, 1))
    return np.asarray(
        cv2.copyMakeBorder(layer, margin, below, margin, right, cv2.BORDER_CONSTANT, value=outside), dtype=np.uint8
    )


def _keypoints(
    image: Layer, method: FeatureMethod, most: int
) -> tuple[Sequence[cv2.KeyPoint], NDArray[np.generic] | None]:
    """Return the strongest keypoints, with the detector's own descriptors where it has them."""
    if method.detector in _WITHOUT:
        keypoints, descriptors = _WITHOUT[method.detector](most).detect(image), None
    else:
        keypoints, descriptors = _WITH_DESCRIPTOR[method.detector](most).detectAndCompute(image, None)
    strongest = sorted(range(len(keypoints)), key=lambda number: -keypoints[number].response)[:most]
    chosen = [keypoints[number] for number in strongest]
    return chosen, None if descriptors is None else descriptors[strongest]


def _prepared(image: Layer, keypoints: Sequence[cv2.KeyPoint], method: FeatureMethod) -> list[cv2.KeyPoint]:
    """Return keypoints with what another one's descriptor reads from them: angle, size and its own octave's number.

    KAZE's and AKAZE's octaves mean the same to SIFT as its own.
    """
    angles = [keypoint.angle for keypoint in keypoints]
    if method.detector in _WITHOUT:
        angles = _intensity_centroids(image, keypoints)
    prepared = []
    for keypoint, angle in zip(keypoints, angles, strict=True):
        size, octave = keypoint.size, keypoint.octave
        if method.detector in _WITHOUT and method.detector != "mser":
            size = _CORNER_PX
        if method.descriptor == "orb":
            octave = int(np.clip(round(math.log(size / _ORB_PX, _ORB_STEP)), 0, 7))
        elif method.descriptor == "sift" and method.detector not in {"kaze", "akaze"}:
            octave = int(np.clip(round(math.log2(size / _SIFT_PX)), 0, 3))
        x, y = keypoint.pt
        prepared.append(cv2.KeyPoint(x, y, size, angle, keypoint.response, octave, keypoint.class_id))
    return prepared


def _intensity_centroids(image: Layer, keypoints: Sequence[cv2.KeyPoint]) -> list[float]:
    """Return in degrees where the centre of brightness around each keypoint lies, ORB's orientation [54] of corners."""
    across = np.arange(-_CENTROID_PX, _CENTROID_PX + 1, dtype=np.float32)
    x, y = np.meshgrid(across, across)
    disc = np.hypot(x, y) <= _CENTROID_PX
    moments = [cv2.filter2D(image, cv2.CV_32F, np.where(disc, axis, np.float32(0.0))) for axis in (x, y)]
    cells = np.rint([keypoint.pt for keypoint in keypoints]).astype(np.intp)
    m10, m01 = (moment[cells[:, 1], cells[:, 0]].astype(np.float64) for moment in moments)
    return [float(angle) for angle in np.degrees(np.arctan2(m01, m10)) % 360.0]
