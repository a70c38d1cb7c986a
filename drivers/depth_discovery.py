"""Which video node is the depth camera: numbers of nodes are not stable, so each is asked what it offers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from drivers import v4l2
from drivers.errors import DriverError, PortMissingError, WrongDeviceError
from drivers.system_calls import SystemCalls
from drivers.video_device import VideoDevice

D435_IDS = {("8086", "0b07"): "D435", ("8086", "0b3a"): "D435i"}  # USB vendor and product, as sysfs writes them


def udev_rules(name: str) -> str:
    """Rules that give the depth node of a D435 the name /dev/`name`: the first of its first interface."""
    return "\n".join(
        f'SUBSYSTEM=="video4linux", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}",'
        ' ENV{ID_USB_INTERFACE_NUM}=="00", ATTR{index}=="0", GROUP="video", MODE="0660",'
        f' SYMLINK+="{name}"'
        for vendor, product in D435_IDS
    )


@dataclass(frozen=True, slots=True)
class DepthNode:
    """A node that streams Z16. model: D435, D435i, or the name that another camera gives itself.

    usb_mbps: speed of the link, 5000 for USB 3, 480 for USB 2; None where it is not on USB.
    """

    path: str
    model: str
    d435: bool
    usb_mbps: float | None = None


@dataclass(frozen=True, slots=True)
class DepthSearch:
    """What a search found: D435s first, then by number; problems: nodes that could not be asked."""

    nodes: tuple[DepthNode, ...]
    problems: tuple[DriverError, ...] = ()
    video_nodes: int = 0

    def choose(self) -> DepthNode:
        """Return the first; raises what kept a node from being asked, else PortMissingError."""
        if self.nodes:
            return self.nodes[0]
        if self.problems:
            raise self.problems[0]
        raise PortMissingError(
            f"no depth camera among {self.video_nodes} video nodes: plug it in, or name its node (/dev/videoN)"
        )


def find_depth_nodes(calls: SystemCalls, sysfs: Path = Path("/sys"), devices: str = "/dev") -> DepthSearch:
    """Ask every video node of the system; nodes that are known to be a D435's and cannot be opened come first."""
    found: list[DepthNode] = []
    problems: list[tuple[bool, DriverError]] = []
    names = video_nodes(sysfs)
    for name in names:
        path = f"{devices}/{name}"
        try:
            found.append(describe_depth_node(path, calls, sysfs))
        except WrongDeviceError:
            continue
        except DriverError as error:
            problems.append((usb_ids(name, sysfs) in D435_IDS, error))
    found.sort(key=lambda node: not node.d435)
    problems.sort(key=lambda problem: not problem[0])
    return DepthSearch(tuple(found), tuple(error for _, error in problems), len(names))


def describe_depth_node(path: str, calls: SystemCalls, sysfs: Path = Path("/sys")) -> DepthNode:
    """Say what streams depth on a node; raises WrongDeviceError if nothing does, or what opening it raises."""
    device = VideoDevice(path, calls)
    try:
        card = require_depth(device)
    finally:
        device.close()
    name = Path(path).resolve().name  # /dev/v4l/by-id has links
    model = D435_IDS.get(usb_ids(name, sysfs))
    speed = _attribute(name, "speed", sysfs)
    usb_mbps = float(speed) if re.fullmatch(r"\d+(\.\d+)?", speed) else None
    return DepthNode(path, model or card, model is not None, usb_mbps)


def require_depth(device: VideoDevice) -> str:
    """Return the name that the camera gives itself; raises WrongDeviceError unless it streams Z16."""
    capability = device.capability()
    needed = v4l2.CAP_VIDEO_CAPTURE | v4l2.CAP_STREAMING
    formats = device.formats() if capability.flags & needed == needed else ()
    if v4l2.Z16 not in formats:
        offers = ", ".join(v4l2.fourcc_text(each).strip() for each in formats) or "no images"
        raise WrongDeviceError(
            f"{device.path}: {capability.card} is not a depth camera here, it streams {offers}, expected Z16:"
            " name another of its nodes, or let the driver search"
        )
    return capability.card


def video_nodes(sysfs: Path) -> list[str]:
    """Names of the video nodes, by their numbers; none where the system has no cameras."""
    folder = sysfs / "class" / "video4linux"
    names = [entry.name for entry in folder.iterdir()] if folder.is_dir() else []
    numbered = [name for name in names if re.fullmatch(r"video\d+", name)]
    return sorted(numbered, key=lambda name: int(name.removeprefix("video")))


def usb_ids(name: str, sysfs: Path) -> tuple[str, str]:
    """USB vendor and product of a video node in lower-case hex, empty where it is not on USB."""
    return _attribute(name, "idVendor", sysfs).lower(), _attribute(name, "idProduct", sysfs).lower()


def _attribute(name: str, attribute: str, sysfs: Path) -> str:
    """Read a file of the USB device, whose folder is above that of the interface that the node belongs to."""
    interface = (sysfs / "class" / "video4linux" / name / "device").resolve()
    try:
        return (interface.parent / attribute).read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return ""
