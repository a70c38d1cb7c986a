"""The YAML half of a map_server map: which image, and what its pixels mean."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from drivers.errors import yaml_fault
from mapping.errors import MapFileError
from mapping.grid import FREE_THRESHOLD, OCCUPIED_THRESHOLD

_DEFAULTS = {"negate": 0, "occupied_thresh": OCCUPIED_THRESHOLD, "free_thresh": FREE_THRESHOLD}
_YES_NO = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


class MapMode(str, Enum):
    """What the pixels of a map image mean."""

    TRINARY = "trinary"  # free, occupied or unknown
    SCALE = "scale"  # brightness between the thresholds is a probability, transparency is unknown
    RAW = "raw"  # the value is the probability in per cent, above 100 is unknown


@dataclass(frozen=True, slots=True)
class MapYaml:
    """The checked content of a map's YAML file.

    image is the path as seen from here; origin is x, y in m and yaw in rad of the image's lower-left corner; the
    thresholds are probabilities; negate: bright is occupied. missing names the keys that were not there.
    """

    image: Path
    mode: MapMode
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool = False
    occupied_thresh: float = OCCUPIED_THRESHOLD
    free_thresh: float = FREE_THRESHOLD
    missing: tuple[str, ...] = ()


def format_map_yaml(settings: MapYaml) -> str:
    """Return the text in map_server's key order, the image by its name alone, every number with all its digits."""
    name = settings.image.name
    quoted = name if re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*", name) else json.dumps(name, ensure_ascii=False)
    return (
        f"image: {quoted}\nmode: {settings.mode.value}\nresolution: {_decimal(settings.resolution_m)}\n"
        f"origin: [{', '.join(_decimal(value) for value in settings.origin)}]\nnegate: {int(settings.negate)}\n"
        f"occupied_thresh: {_decimal(settings.occupied_thresh)}\nfree_thresh: {_decimal(settings.free_thresh)}\n"
    )


def read_map_yaml(path: Path) -> MapYaml:
    """Read and check a map's YAML file; raises MapFileError."""
    content = _load(path)
    image = content.get("image")
    if not isinstance(image, str) or not image:
        raise MapFileError(f"{path}: image is {image!r}, expected the name of the image file: add 'image: NAME.pgm'")
    modes = [mode.value for mode in MapMode]
    mode = content.get("mode", MapMode.TRINARY.value)
    if mode not in modes:
        raise MapFileError(f"{path}: mode is {mode!r}, expected one of {', '.join(modes)}: correct 'mode: ...'")
    resolution_m = _number(content.get("resolution"), "resolution", path)
    if resolution_m <= 0.0:
        raise MapFileError(f"{path}: resolution is {resolution_m}, expected metres per pixel above 0, such as 0.05")
    missing = tuple(key for key in _DEFAULTS if key not in content)
    content = {**_DEFAULTS, **content}
    occupied, free = (_number(content[key], key, path) for key in ("occupied_thresh", "free_thresh"))
    if not 0.0 <= free < occupied <= 1.0:
        raise MapFileError(
            f"{path}: free_thresh {free} and occupied_thresh {occupied}, expected 0 <= free < occupied <= 1: "
            f"usual are {FREE_THRESHOLD} and {OCCUPIED_THRESHOLD}"
        )
    origin, negate = _origin(content.get("origin"), path), _flag(content["negate"], path)
    return MapYaml(path.parent / image, MapMode(mode), resolution_m, origin, negate, occupied, free, missing)


def _load(path: Path) -> dict[Any, Any]:
    try:
        content = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError as error:
        raise MapFileError(f"{path}: no such file: give the .yaml of a saved map") from error
    except OSError as error:
        raise MapFileError(f"{path}: cannot read the map's YAML: {error.strerror or error}") from error
    except (YAMLError, ValueError) as error:
        raise MapFileError(f"{path}: not a YAML file ({yaml_fault(error)}): give the .yaml of a saved map") from error
    if not isinstance(content, dict):
        found = "nothing" if content is None else type(content).__name__
        raise MapFileError(f"{path}: holds {found}, expected 'key: value' lines: image, resolution, origin")
    return content


def _origin(value: object, path: Path) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise MapFileError(f"{path}: origin is {value!r}, expected [x, y, yaw] of the lower-left corner in m and rad")
    x, y, yaw = (_number(item, "origin", path) for item in value)
    return x, y, yaw


def _flag(value: object, path: Path) -> bool:
    if isinstance(value, int):
        return bool(value)
    if str(value).lower() not in _YES_NO:
        raise MapFileError(f"{path}: negate is {value!r}, expected 0 or 1: correct the line 'negate: ...'")
    return _YES_NO[str(value).lower()]


def _number(value: object, key: str, path: Path) -> float:
    try:
        number = float(value) if isinstance(value, (int, float, str)) and not isinstance(value, bool) else math.nan
    except (ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise MapFileError(f"{path}: {key} is {value!r}, expected a finite number: correct the line '{key}: ...'")
    return number


def _decimal(value: float) -> str:
    """Return the shortest exact decimal; with a point, because YAML 1.1 readers take 1e-05 for a word."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
