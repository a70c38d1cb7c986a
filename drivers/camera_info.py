"""Intrinsics of a camera from a file: the YAML of ROS's camera_calibration, or a sensor_msgs/CameraInfo as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from drivers.errors import RecordingError, yaml_fault
from drivers.messages import Pinhole

_ADVICE = "expected a camera_info YAML: image_width, image_height, camera_matrix with 9 numbers in data"


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """A calibrated camera; distorted: the file has distortion coefficients, which a pinhole leaves out."""

    camera: Pinhole
    distorted: bool


def read_camera_info(path: Path) -> CameraInfo:
    """Read the matrix K of an unrectified image; raises RecordingError for a file that is none."""
    try:
        content = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error}): name a camera_info YAML") from error
    except (YAMLError, ValueError) as error:
        raise RecordingError(f"{path}: not a YAML file ({yaml_fault(error)}): {_ADVICE}") from error
    if not isinstance(content, Mapping):
        raise RecordingError(f"{path}: holds no keys: {_ADVICE}")
    width, height = (_number(content, (f"image_{name}", name), path) for name in ("width", "height"))
    matrix = _numbers(content, ("camera_matrix", "k", "K"), path)
    if len(matrix) != 9:
        raise RecordingError(f"{path}: camera matrix of {len(matrix)} numbers, expected 9: {_ADVICE}")
    fx, _, cx, _, fy, cy, *_ = matrix
    if width != int(width) or height != int(height) or min(width, height) < 1 or fx <= 0 or fy <= 0:
        raise RecordingError(
            f"{path}: {width:g}x{height:g} pixels, focal lengths {fx:g} and {fy:g}, expected all above 0: {_ADVICE}"
        )
    distortion = _numbers(content, ("distortion_coefficients", "d", "D"), path, needed=False)
    return CameraInfo(Pinhole(int(width), int(height), fx, fy, cx, cy), any(distortion))


def _find(content: Mapping[str, object], names: tuple[str, ...]) -> object:
    return next((content[name] for name in names if name in content), None)


def _number(content: Mapping[str, object], names: tuple[str, ...], path: Path) -> float:
    return _finite(_find(content, names), names[0], path)


def _numbers(content: Mapping[str, object], names: tuple[str, ...], path: Path, *, needed: bool = True) -> list[float]:
    value = _find(content, names)
    if isinstance(value, Mapping):  # camera_calibration: rows, cols, data
        value = value.get("data")
    if value is None and not needed:
        return []
    if not isinstance(value, list):
        raise RecordingError(f"{path}: {names[0]} is {value!r}, expected a list of numbers: {_ADVICE}")
    return [_finite(each, names[0], path) for each in value]


def _finite(value: object, name: str, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise RecordingError(f"{path}: {name} holds {value!r}, expected a finite number: {_ADVICE}")
    return float(value)
