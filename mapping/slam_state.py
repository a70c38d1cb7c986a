"""A drive's state as one file (.npz), from which another run goes on: keyframes, graph and scans."""

from __future__ import annotations

import contextlib
import os
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.errors import MapFileError
from mapping.graph_state import GraphState

STATE_NAME = "slam_state.npz"
_FORMAT = 2


def write_state(path: Path, state: GraphState) -> None:
    """Write a state, whole or not at all; raises MapFileError."""
    partial = path.with_name(path.name + ".part")
    try:
        with partial.open("wb") as stream:
            np.savez(stream, allow_pickle=False, format=np.array(_FORMAT), **state.arrays)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise MapFileError(f"{path}: cannot write the state: {error.strerror or error}") from error


def read_state(path: Path) -> GraphState:
    """Read what `write_state` wrote; `path` may also be the folder of a run. Raises MapFileError."""
    file = path / STATE_NAME if path.is_dir() else path
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            arrays: dict[str, NDArray[np.generic]] = {name: stored[name] for name in stored.files}
    except FileNotFoundError as error:
        raise MapFileError(f"{file}: no such file: name the folder of a run that saved its state") from error
    except IsADirectoryError as error:
        raise MapFileError(f"{file}: a folder: name {STATE_NAME} or the folder of a run") from error
    except (OSError, ValueError, TypeError, AttributeError, zipfile.BadZipFile, EOFError) as error:
        raise MapFileError(f"{file}: not the state of a run, or a damaged one: name the folder of a run") from error
    version = arrays.pop("format", None)
    if version is None or int(version) != _FORMAT:
        raise MapFileError(f"{file}: a state of format {version}, this program reads {_FORMAT}: map anew with `replay`")
    try:
        return GraphState(arrays)
    except ValueError as error:
        raise MapFileError(f"{file}: damaged state: {error}") from error
