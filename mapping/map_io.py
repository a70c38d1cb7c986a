"""Map files: the YAML + image of ROS map_server, and our lossless grid (.npz) beside them.

Read and written as nav2 does (see map_image), except that resolution and origin keep all their digits.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.lib.npyio import NpzFile

from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_image import ImageFormat, decode_image, encode_image, to_log_odds
from mapping.map_yaml import MapMode, MapYaml, format_map_yaml, read_map_yaml

__all__ = [
    "LoadedMap",
    "MapFiles",
    "MapMode",
    "read_map",
    "read_map_with_warnings",
    "write_lossless",
    "write_map",
]


_USUAL_RESOLUTION_M = 0.005, 1.0
_POSSIBLE_RESOLUTION_M = 1e-4, 1e3  # beyond, sizes and areas in m leave what floating point can hold
_FARTHEST_ORIGIN_M = 1e8


@dataclass(frozen=True, slots=True)
class MapFiles:
    """The files of one written map."""

    yaml: Path
    image: Path
    lossless: Path


@dataclass(frozen=True, slots=True, eq=False)
class LoadedMap:
    """A map as read; warnings are one line each; provenance is empty where the file carries none."""

    grid: OccupancyGrid
    warnings: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))


def write_map(
    stem: Path,
    grid: OccupancyGrid,
    *,
    mode: MapMode = MapMode.TRINARY,
    image_format: ImageFormat = "pgm",
    provenance: Mapping[str, str] | None = None,
) -> MapFiles:
    """Write <stem>.yaml, <stem>.pgm or .png, and the lossless <stem>.npz into a folder that exists.

    However the process ends, a YAML that is there fits its image and the .npz is whole (the old or the new one). Raises
    MapFileError where a file cannot be written, and for mode scale without PNG.
    """
    if mode is MapMode.SCALE and image_format != "png":
        raise MapFileError(f"{stem}: mode scale marks unknown by transparency, which {image_format} lacks: write png")
    files = MapFiles(*(stem.with_name(stem.name + suffix) for suffix in (".yaml", f".{image_format}", ".npz")))
    x, y, yaw = grid.origin.tolist()
    yaml = format_map_yaml(MapYaml(files.image, mode, grid.resolution_m, (x, y, yaw)))
    contents = {
        files.lossless: _npz_bytes(grid, provenance),
        files.image: encode_image(grid, mode, image_format),
        files.yaml: yaml.encode("utf-8"),
    }
    _replace_files(contents, last=files.yaml)
    return files


def write_lossless(path: Path, grid: OccupancyGrid, *, provenance: Mapping[str, str] | None = None) -> None:
    """Write log-odds, origin, resolution and provenance as .npz, whole or not at all; raises MapFileError."""
    _replace_files({path: _npz_bytes(grid, provenance)}, last=path)


def read_map(path: Path) -> OccupancyGrid:
    """Read a .yaml (from the image it names, not from an .npz beside it) or a lossless .npz; raises MapFileError."""
    return read_map_with_warnings(path).grid


def read_map_with_warnings(path: Path) -> LoadedMap:
    """Read a map like `read_map`, and tell what is suspicious about it."""
    if path.suffix.lower() == ".npz":
        return _read_lossless(path)
    if path.suffix.lower() not in {".yaml", ".yml"}:
        raise MapFileError(f"{path}: expected a .yaml or .npz file: a map image is named by the .yaml beside it")
    settings = read_map_yaml(path)
    try:
        data = settings.image.read_bytes()
    except OSError as error:
        reason = error.strerror or error
        raise MapFileError(f"{path}: its image {settings.image}: {reason}: put it there or correct 'image'") from error
    gray, opaque = decode_image(data, settings.image)
    log_odds, warnings = to_log_odds(gray, opaque, settings)
    missing = tuple(f"{key} is missing, taken as {getattr(settings, key):g}" for key in settings.missing)
    grid = OccupancyGrid(log_odds, settings.resolution_m, np.array(settings.origin))
    _refuse_impossible(path, grid)
    return LoadedMap(grid, tuple(f"{path}: {warning}" for warning in (*missing, *_odd_scale(grid), *warnings)))


def _read_lossless(path: Path) -> LoadedMap:
    """Read what `write_lossless` wrote."""
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise MapFileError(f"{path}: no such file: give the .npz or .yaml of a saved map") from error
    except OSError as error:
        raise MapFileError(f"{path}: cannot read the map: {error.strerror or error}: check the file") from error
    try:
        data = np.load(io.BytesIO(content), allow_pickle=False)  # np.load(path) leaves a broken file open
        if not isinstance(data, NpzFile):
            raise TypeError("it holds one array")
        provenance = MappingProxyType(json.loads(str(data["provenance"])))
        grid = OccupancyGrid(data["log_odds"], float(data["resolution_m"]), data["origin"])
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise MapFileError(f"{path}: not a lossless map, or a damaged one: use the .yaml beside it") from error
    _refuse_impossible(path, grid)
    return LoadedMap(grid, tuple(f"{path}: {warning}" for warning in _odd_scale(grid)), provenance)


def _refuse_impossible(path: Path, grid: OccupancyGrid) -> None:
    """Raise MapFileError for a map that no computation in metres can use."""
    finest_m, coarsest_m = _POSSIBLE_RESOLUTION_M
    if not finest_m <= grid.resolution_m <= coarsest_m:
        raise MapFileError(
            f"{path}: resolution is {grid.resolution_m:g} m a cell, expected {finest_m:g} to {coarsest_m:g}"
        )
    x_m, y_m, _ = grid.origin.tolist()
    if max(abs(x_m), abs(y_m)) > _FARTHEST_ORIGIN_M:
        raise MapFileError(f"{path}: origin is {x_m:g}, {y_m:g} m, expected less than {_FARTHEST_ORIGIN_M:g} m away")


def _odd_scale(grid: OccupancyGrid) -> tuple[str, ...]:
    """Return a line where the resolution is none of a building's map; what follows from it would be as far off."""
    resolution_m = grid.resolution_m
    finest_m, coarsest_m = _USUAL_RESOLUTION_M
    if finest_m <= resolution_m <= coarsest_m:
        return ()
    rows, cols = grid.log_odds.shape
    size = f"{cols * resolution_m:.3g} m x {rows * resolution_m:.3g} m"
    guesses = ((resolution_m / 1000.0, "mm"), (1.0 / resolution_m, "cells a metre"))
    meant = "".join(f", {guess:g} if {unit} were meant" for guess, unit in guesses if finest_m <= guess <= coarsest_m)
    return (f"resolution is {resolution_m:g} m a cell, which makes the map {size}: is it right? Usual is 0.05{meant}",)


def _npz_bytes(grid: OccupancyGrid, provenance: Mapping[str, str] | None) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        log_odds=grid.log_odds,
        origin=grid.origin,
        resolution_m=np.float64(grid.resolution_m),
        provenance=np.array(json.dumps(dict(provenance or {}), sort_keys=True)),
    )
    return buffer.getvalue()


def _replace_files(contents: Mapping[Path, bytes], *, last: Path) -> None:
    """Put the files in place, `last` last, once all are on the disk whole.

    Where `last` describes the others and would change, the old one goes first, so that it never describes new ones.
    """
    staged = {path: path.with_name(f".{path.name}.{os.getpid()}.tmp") for path in contents}
    try:
        for path, temporary in staged.items():
            with temporary.open("wb") as file:
                file.write(contents[path])
                file.flush()
                os.fsync(file.fileno())
        if len(contents) > 1 and last.exists() and last.read_bytes() != contents[last]:
            last.unlink()
        for path, temporary in staged.items():
            temporary.replace(path)
    except OSError as error:
        reason = error.strerror or error
        raise MapFileError(f"{last}: cannot write the map: {reason}: check the folder and the disk") from error
    finally:
        for temporary in staged.values():
            with contextlib.suppress(OSError):  # a failing clean-up must not hide what failed before it
                temporary.unlink()
