"""Which files make up a recording, and what each of them is: told by its first bytes, never by its name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from drivers import recording_mcap, recording_sqlite
from drivers.errors import RecordingError
from drivers.recording_mcap_file import McapFile
from drivers.recording_sqlite import SqliteFile
from drivers.recording_storage import Storage

ACCEPTED = (
    "accepted: MCAP (.mcap), a ROS 2 bag file (.db3), a folder with either, a CARMEN or tinySLAM log (plain, .gz, "
    ".bz2), a .bag of the RealSense SDK, a folder of 16-bit depth PNGs"
)
_OVERLAP_NS = 1_000_000_000  # parts of one recording follow each other, apart from what was in flight


def open_storages(path: Path) -> tuple[list[Storage], list[str]]:
    """Return the open files of the recording at `path` and what is missing of it.

    Raises RecordingError where nothing can be opened, or where a folder holds several recordings.
    """
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder")
    if not path.is_dir():
        return [open_storage(path)], []
    files, problems = _bag_files(path)
    storages: list[Storage] = []
    try:
        for file in files:
            _open_part(file, storages, problems)
        if not storages:
            raise RecordingError(problems[0])
        if not (path / "metadata.yaml").is_file():
            _refuse_overlap(storages)
    except BaseException:
        for storage in storages:
            storage.close()
        raise
    return storages, problems


def open_storage(path: Path) -> Storage:
    """Return one open file; raises RecordingError that says what the file is if it is not one that can be read."""
    try:
        with path.open("rb") as stream:
            head = stream.read(16)
        if head.startswith(recording_mcap.MAGIC):
            return McapFile(path)
        if head.startswith(recording_sqlite.MAGIC):
            return SqliteFile(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not head:
        raise RecordingError(f"{path}: empty recording (0 bytes)")
    if head.startswith(b"#ROSBAG V"):
        raise RecordingError(f"{path}: a ROS 1 bag; convert it to ROS 2 with rosbags-convert (comes with rosbags)")
    if head.startswith(b"\x28\xb5\x2f\xfd"):
        raise RecordingError(f"{path}: compressed as a whole file; uncompress it first (zstd -d)")
    if recording_mcap.MAGIC.startswith(head) or recording_sqlite.MAGIC.startswith(head):
        raise RecordingError(f"{path}: cut inside its first {len(head)} bytes, nothing left to read")
    raise RecordingError(f"{path}: not a recording: it starts with {head[:8]!r}; {ACCEPTED}")


def _open_part(file: Path, storages: list[Storage], problems: list[str]) -> None:
    """Open one file of several; if it cannot be read the others still can."""
    try:
        storages.append(open_storage(file))
    except RecordingError as error:
        problems.append(str(error))


def _bag_files(folder: Path) -> tuple[list[Path], list[str]]:
    """Return the files of a bag folder in order, by its metadata.yaml if that names any, and what it names in vain."""
    named = _named_files(folder / "metadata.yaml")
    present = [folder / name for name in named if (folder / name).is_file()]
    if present:
        missing = [name for name in named if not (folder / name).is_file()]
        return present, [f"{folder / name}: named in metadata.yaml, but missing" for name in missing]
    files = sorted((file for file in folder.iterdir() if file.suffix in (".mcap", ".db3")), key=_natural_order)
    if not files:
        bags = "only ROS 1 bags (convert with rosbags-convert)" if any(folder.glob("*.bag")) else "no recording"
        raise RecordingError(f"{folder}: {bags} in this folder; {ACCEPTED}")
    recordings = {(re.sub(r"_\d+$", "", file.stem), file.suffix) for file in files}
    if len(recordings) > 1:
        names = ", ".join(file.name for file in files[:3])
        raise RecordingError(f"{folder}: {len(recordings)} different recordings ({names}...); name one of the files")
    return files, []


def _named_files(metadata: Path) -> list[str]:
    """Return the file names in a rosbag2 metadata.yaml; [] where it is absent or not one."""
    try:
        content = YAML(typ="safe", pure=True).load(metadata)
        paths = content["rosbag2_bagfile_information"]["relative_file_paths"]
        return [Path(name).name for name in paths]
    except (OSError, YAMLError, UnicodeDecodeError, KeyError, TypeError):
        return []


def _natural_order(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts part_2 before part_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _refuse_overlap(storages: Sequence[Storage]) -> None:
    in_time = sorted((storage for storage in storages if storage.end_ns), key=lambda storage: storage.start_ns)
    for first, second in pairwise(in_time):
        if second.start_ns < first.end_ns - _OVERLAP_NS:
            names = f"{first.path.name} and {second.path.name}"
            raise RecordingError(f"{first.path.parent}: {names} cover the same time: two recordings; name one of them")
