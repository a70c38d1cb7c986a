"""Folders of 16-bit depth PNGs with intrinsics and, where known, the camera's poses, as a recording.

The layout is that of 7-Scenes (Glocker et al. 2013): frame-000123.depth.png in mm, 0 and 65535 no measurement;
frame-000123.pose.txt the 4x4 camera-to-world matrix; camera-intrinsics.txt the 3x3 matrix. Other PNGs with a frame
number at the end of their names are taken as well, those called depth if there are such. Stamps come from stamps.txt
(lines of seconds and file name, as in depth.txt of TUM RGB-D), else from the frame numbers at 30 Hz.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from drivers.depth_codec import pinhole
from drivers.depth_pixels import METRES_UNIT_M, DepthCounts, png_counts
from drivers.errors import RecordingError
from drivers.messages import DepthImage, FloatArray, Message, Pinhole, Transform
from drivers.recording_storage import TopicInfo
from drivers.rotations import quaternion
from drivers.sources import Closing
from drivers.wording import counted

WORLD_FRAME, CAMERA_FRAME = "world", "camera_depth_optical_frame"
DEPTH_TOPIC, POSE_TOPIC = "depth", "pose"
INTRINSICS, STAMPS = "camera-intrinsics.txt", ("stamps.txt", "depth.txt")
FRAMES_PER_S = 30
NO_MEASUREMENT = 65535
_DEPTH_ENDING = ".depth.png"
_LONGEST_NOTE = 65536  # bytes; longer text files are no notes about the camera
_OFF_ROTATION = 1e-2  # files give a few digits only


@dataclass(frozen=True, slots=True)
class _Frame:
    """One PNG; number: that in its name."""

    stamp_ns: int
    number: int
    image: Path

    @property
    def pose(self) -> Path:
        name = self.image.name
        ending = _DEPTH_ENDING if name.lower().endswith(_DEPTH_ENDING) else ".png"
        return self.image.with_name(f"{name[: -len(ending)]}.pose.txt")


class DepthFolder(Closing):
    """An open folder; a MessageSource with a table of contents, see Recording.

    intrinsics: a file with the 3x3 matrix, instead of the folder's own. unit_m: metres per count. Text files about the
    camera are in `metadata`. Raises RecordingError without intrinsics, and if no image or stamp can be read.
    """

    has_raw = False
    scan_topic: str | None = None
    odometry_topic: str | None = None
    depth_topic: str | None = DEPTH_TOPIC

    def __init__(self, path: Path, *, intrinsics: Path | None = None, unit_m: float = METRES_UNIT_M) -> None:
        self.path = path
        self.skipped: dict[str, int] = {}
        self._unit_m = unit_m
        self._faults: Counter[str] = Counter()
        self._lost = False
        self._frames = _frames(path)
        self._camera = self._find_camera(intrinsics or path / INTRINSICS)
        poses = sum(frame.pose.is_file() for frame in self._frames)
        self.start_ns, self.end_ns = self._frames[0].stamp_ns, self._frames[-1].stamp_ns
        self.topics = [TopicInfo(DEPTH_TOPIC, "16-bit PNG", len(self._frames), decoded=True)]
        if poses:
            self.topics.append(TopicInfo(POSE_TOPIC, "4x4 camera-to-world", poses, decoded=True))
        notes = _notes(path)
        self.metadata = {"depth_folder": notes} if notes else {}

    @property
    def truncated(self) -> bool:
        """True if an image could not be read."""
        return self._lost

    @property
    def problems(self) -> list[str]:
        """What could not be read, one line for each kind."""
        return [f"{counted(count, 'file')} cannot be read: {why}" for why, count in self._faults.items()]

    def messages(self, scan_topic: str | None = None) -> Iterator[Message]:
        """Yield each frame's pose, where it has one, as a Transform of the camera in the world, and its depth image.

        Raises RecordingError for any scan_topic.
        """
        if scan_topic is not None:
            raise RecordingError(f"{self.path}: no scans called {scan_topic!r}: a folder of depth images holds none")
        return self._messages()

    def poses(self) -> Iterator[tuple[int, FloatArray]]:
        """Yield stamp (ns) and T_world_camera (4, 4) of each frame that has a pose; files without one are left out."""
        for frame in self._frames:
            if frame.pose.is_file():
                with suppress(ValueError):  # counted by messages()
                    yield frame.stamp_ns, _read_pose(frame.pose)

    def close(self) -> None:
        """Nothing is held open between readings."""

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def _messages(self) -> Iterator[Message]:
        self._faults.clear()
        for frame in self._frames:
            yield from self._transforms(frame)
            counts = self._counts(frame)
            if counts is None:
                continue
            if counts.shape != (self._camera.height, self._camera.width):
                self._note_lost(
                    f"{counts.shape[1]}x{counts.shape[0]} px, others {self._camera.width}x{self._camera.height}"
                )
                continue
            depth = np.where(counts == NO_MEASUREMENT, 0, counts).astype(np.uint16)
            yield DepthImage(frame.stamp_ns, depth, self._unit_m, self._camera, CAMERA_FRAME, frame.number)

    def _transforms(self, frame: _Frame) -> Iterator[Transform]:
        """Yield the pose of a frame that has one."""
        if not frame.pose.is_file():
            return
        try:
            pose = _read_pose(frame.pose)
        except ValueError as error:
            self._faults[str(error)] += 1
        else:
            yield Transform(frame.stamp_ns, WORLD_FRAME, CAMERA_FRAME, pose[:3, 3], quaternion(pose[:3, :3]))

    def _counts(self, frame: _Frame) -> DepthCounts | None:
        try:
            return png_counts(frame.image.read_bytes())
        except OSError as error:
            self._note_lost(error.strerror or str(error))
        except ValueError as error:
            self._note_lost(str(error))
        return None

    def _note_lost(self, why: str) -> None:
        self._faults[why] += 1
        self._lost = True

    def _find_camera(self, intrinsics: Path) -> Pinhole:
        """Return the camera: intrinsics from the file, the image size from the first image that can be read."""
        if not intrinsics.is_file() and intrinsics.parent != self.path:
            raise RecordingError(f"{intrinsics}: no such file: it should hold the camera's 3x3 matrix")
        if not intrinsics.is_file():
            raise RecordingError(
                f"{self.path}: depth images without {intrinsics.name}: give a file with their 3x3 matrix (--intrinsics)"
            )
        k = _matrix(intrinsics, 3)
        shapes = (counts.shape for frame in self._frames if (counts := self._counts(frame)) is not None)
        shape = next(shapes, None)
        if shape is None:
            raise RecordingError(
                f"{self.path}: none of its {len(self._frames)} images can be read: {next(iter(self._faults))}"
            )
        rows, cols = shape
        camera = pinhole((cols, rows), (k[0, 0], k[1, 1], k[0, 2], k[1, 2]), str(intrinsics))
        if not (0 < camera.cx < cols and 0 < camera.cy < rows):
            raise RecordingError(
                f"{intrinsics}: its centre ({camera.cx}, {camera.cy}) is outside of images of {cols}x{rows} px"
            )
        return camera


def is_depth_folder(path: Path) -> bool:
    """Whether this is a folder with PNGs and no bag."""
    try:
        return path.is_dir() and bool(_images(path)) and not any(path.glob("*.mcap")) and not any(path.glob("*.db3"))
    except OSError:
        return False


def _images(folder: Path) -> list[Path]:
    """Return the depth images: those named as in 7-Scenes, else those called depth, else all PNGs."""
    files = [file for file in folder.iterdir() if file.suffix.lower() == ".png"]
    named = [file for file in files if file.name.lower().endswith(_DEPTH_ENDING)]
    return named or [file for file in files if "depth" in file.name.lower()] or files


def _frames(folder: Path) -> list[_Frame]:
    """Return the frames in the order of their stamps."""
    stamps = next((_read_stamps(folder / name) for name in STAMPS if (folder / name).is_file()), None)
    frames: dict[int, _Frame] = {}
    for image in sorted(_images(folder)):
        digits = re.findall(r"\d+", image.name)
        if not digits:
            raise RecordingError(f"{image}: no frame number in its name")
        number = int(digits[-1])
        if number in frames:
            raise RecordingError(f"{folder}: {frames[number].image.name} and {image.name} are both frame {number}")
        if stamps is not None and image.name not in stamps:
            raise RecordingError(f"{folder}: no stamp for {image.name}")
        stamp_ns = stamps[image.name] if stamps is not None else round(number * 10**9 / FRAMES_PER_S)
        frames[number] = _Frame(stamp_ns, number, image)
    return sorted(frames.values(), key=lambda frame: (frame.stamp_ns, frame.number))


def _read_stamps(file: Path) -> dict[str, int]:
    """Return stamps (ns) by file name."""
    stamps: dict[str, int] = {}
    for number, line in enumerate(_text(file).splitlines(), 1):
        fields = line.split()
        if not fields or line.startswith("#"):
            continue
        try:
            seconds, name = fields
            stamps[Path(name).name] = int(Decimal(seconds) * 10**9)
        except (ValueError, InvalidOperation, OverflowError) as error:
            raise RecordingError(f"{file}: line {number} is not 'seconds file-name': {line[:40]!r}") from error
    return stamps


def _matrix(file: Path, side: int) -> FloatArray:
    """Return the square matrix in a text file; raises RecordingError if there is none of this size."""
    try:
        values = np.array(_text(file).split(), dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if values.size != side * side:
        raise RecordingError(f"{file}: not a {side}x{side} matrix of numbers")
    return values.reshape(side, side)


def _read_pose(file: Path) -> FloatArray:
    """Return the 4x4 pose in a text file; raises ValueError if there is none, as where tracking was lost."""
    try:
        pose = _matrix(file, 4)
    except RecordingError as error:
        raise ValueError("no 4x4 matrix in a pose file") from error
    rotation = pose[:3, :3]
    if not np.isfinite(pose).all() or np.abs(rotation @ rotation.T - np.eye(3)).max() > _OFF_ROTATION:
        raise ValueError("a pose file's matrix is no pose")
    if np.linalg.det(rotation) < 0:
        raise ValueError("a pose file's matrix is a reflection")
    return pose


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{file}: not a text file") from error


def _notes(folder: Path) -> dict[str, str]:
    """Return the text files that are neither poses nor stamps, such as intrinsics and direction of gravity."""
    notes = {}
    for file in sorted(folder.glob("*.txt")):
        if not file.name.endswith(".pose.txt") and file.name not in STAMPS and file.stat().st_size <= _LONGEST_NOTE:
            notes[file.name] = file.read_bytes().decode("utf-8", "replace")
    return notes
