"""Discovery over a made-up system: a sysfs tree of files and links, and nodes that say what they stream."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from drivers import v4l2
from drivers.d435_emulator import D435Emulator
from drivers.depth_discovery import (
    D435_IDS,
    describe_depth_node,
    find_depth_nodes,
    require_depth,
    udev_rules,
    usb_ids,
    video_nodes,
)
from drivers.errors import DriverError, PortMissingError, PortPermissionError, WrongDeviceError
from drivers.system_calls import LinuxSystemCalls
from drivers.video_device import VideoDevice

CAPTURE = v4l2.CAP_VIDEO_CAPTURE | v4l2.CAP_STREAMING


@dataclass
class Node:
    card: str
    formats: tuple[str, ...] = ()
    flags: int = CAPTURE
    error: int = 0


@dataclass
class System(LinuxSystemCalls):
    """System calls of a machine with these nodes: they can be asked who they are, no more."""

    nodes: dict[str, Node]
    opened: list[str] = field(default_factory=list)

    def open(self, path):
        node = self.nodes[path]
        if node.error:
            raise OSError(node.error, os.strerror(node.error))
        self.opened.append(path)
        return list(self.nodes).index(path)

    def close(self, descriptor):
        self.opened.remove(list(self.nodes)[descriptor])

    def ioctl(self, descriptor, request, argument):
        node = list(self.nodes.values())[descriptor]
        if request == v4l2.QUERYCAP:
            whole = v4l2.CAP_DEVICE_CAPS | CAPTURE | v4l2.CAP_META_CAPTURE
            v4l2.CAPABILITY.pack_into(argument, 0, b"uvcvideo", node.card.encode(), b"usb", 0, whole, node.flags)
            return
        assert request == v4l2.ENUM_FMT
        index, kind, *_ = v4l2.FORMAT_DESCRIPTION.unpack(argument)
        if index >= len(node.formats):
            raise OSError(errno.EINVAL, "no more")
        v4l2.FORMAT_DESCRIPTION.pack_into(argument, 0, index, kind, 0, b"", v4l2.fourcc(node.formats[index]))


@dataclass
class Machine:
    """Files that the kernel would show for USB cameras, and the nodes themselves."""

    sysfs: Path
    nodes: dict[str, Node] = field(default_factory=dict)

    def plug(self, usb: str, ids: tuple[str, str], speed: str, nodes: dict[int, Node]) -> None:
        device = self.sysfs / "devices" / "usb" / usb
        interface = device / f"{usb}:1.0"
        interface.mkdir(parents=True)
        for name, text in zip(("idVendor", "idProduct", "speed"), (*ids, speed), strict=True):
            (device / name).write_text(text + "\n", encoding="ascii")
        for number, node in nodes.items():
            self._add(number, node, interface)

    def build_in(self, number: int, node: Node) -> None:
        """A camera that is not on USB."""
        platform = self.sysfs / "devices" / "platform" / f"csi{number}"
        platform.mkdir(parents=True)
        self._add(number, node, platform)

    def _add(self, number: int, node: Node, parent: Path) -> None:
        folder = self.sysfs / "class" / "video4linux" / f"video{number}"
        folder.mkdir(parents=True)
        (folder / "device").symlink_to(parent)
        self.nodes[f"/dev/video{number}"] = node

    def find(self):
        system = System(self.nodes)
        search = find_depth_nodes(system, self.sysfs)
        assert not system.opened, "every node is closed again"
        return search


def realsense(first: int, error: int = 0) -> dict[int, Node]:
    card = "Intel(R) RealSense(TM) Depth Ca"
    return {
        first: Node(card, ("Z16 ",), error=error),
        first + 1: Node(card, flags=v4l2.CAP_META_CAPTURE | v4l2.CAP_STREAMING, error=error),
        first + 2: Node(card, ("GREY", "UYVY"), error=error),
        first + 4: Node(card, ("YUYV",), error=error),
    }


@pytest.fixture
def machine(tmp_path):
    machine = Machine(tmp_path)
    machine.plug("1-1", ("046d", "0825"), "480", {0: Node("Webcam", ("YUYV", "MJPG")), 1: Node("Webcam", flags=0)})
    return machine


@pytest.mark.parametrize(("product", "model"), [("0b07", "D435"), ("0b3a", "D435i"), ("0B3A", "D435i")])
def test_the_depth_node_is_found_among_a_camera_s_own_and_others(machine, product, model):
    machine.plug("2-1", ("8086", product), "5000", realsense(8))
    node = machine.find().choose()
    assert (node.path, node.model, node.d435, node.usb_mbps) == ("/dev/video8", model, True, 5000.0)


def test_a_d435_comes_before_other_depth_cameras_and_nodes_by_number(machine):
    machine.build_in(3, Node("ToF", ("Z16 ",)))
    machine.plug("2-1", ("8086", "0b07"), "480", realsense(10))
    machine.plug("2-2", ("8086", "0b07"), "5000", realsense(20))
    search = machine.find()
    assert [node.path for node in search.nodes] == ["/dev/video10", "/dev/video20", "/dev/video3"]
    other = search.nodes[2]
    assert (other.model, other.d435, other.usb_mbps) == ("ToF", False, None)


def test_no_depth_camera_says_how_many_nodes_were_asked(machine):
    with pytest.raises(PortMissingError, match="no depth camera among 2 video nodes: plug it in"):
        machine.find().choose()


def test_a_d435_that_may_not_be_opened_is_what_the_user_is_told(machine):
    machine.nodes["/dev/video0"].error = errno.EIO
    machine.plug("2-1", ("8086", "0b07"), "5000", realsense(2, error=errno.EACCES))
    search = machine.find()
    assert len(search.problems) == 5
    with pytest.raises(PortPermissionError, match="/dev/video2: .*group video"):
        search.choose()


def test_a_problem_with_one_node_does_not_hide_a_camera(machine):
    machine.nodes["/dev/video0"].error = errno.EACCES
    machine.plug("2-1", ("8086", "0b07"), "5000", realsense(2))
    assert machine.find().choose().path == "/dev/video2"


def test_a_system_without_cameras_has_no_nodes(tmp_path):
    assert video_nodes(tmp_path) == []
    with pytest.raises(PortMissingError, match="among 0 video nodes"):
        find_depth_nodes(System({}), tmp_path).choose()


def test_this_machine_can_be_searched():
    try:
        search = find_depth_nodes(LinuxSystemCalls())
    except DriverError:
        pytest.skip("not 64-bit Linux")
    assert len(search.nodes) + len(search.problems) <= search.video_nodes


def test_another_node_of_the_camera_is_refused_with_what_it_streams(machine):
    system = System(realsense_paths())
    device = VideoDevice("/dev/video2", system)
    with pytest.raises(WrongDeviceError, match="it streams GREY, UYVY, expected Z16"):
        require_depth(device)
    device.close()
    with pytest.raises(WrongDeviceError, match="it streams no images"):
        describe_depth_node("/dev/video1", system, machine.sysfs)


def realsense_paths() -> dict[str, Node]:
    return {f"/dev/video{number}": node for number, node in realsense(0).items()}


def test_the_emulated_camera_is_found_like_a_real_one(tmp_path):
    machine = Machine(tmp_path)
    machine.plug("2-1", ("8086", "0b07"), "5000", {0: Node("")})
    node = find_depth_nodes(D435Emulator([]), tmp_path).choose()
    assert (node.path, node.model) == ("/dev/video0", "D435")
    assert usb_ids("video0", tmp_path) == ("8086", "0b07")


def test_a_rule_names_the_depth_node_of_each_model() -> None:
    for (vendor, product), rule in zip(D435_IDS, udev_rules("depth").splitlines(), strict=True):
        assert f'ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}"' in rule
        assert rule.startswith('SUBSYSTEM=="video4linux", ')
        assert rule.endswith('ATTR{index}=="0", GROUP="video", MODE="0660", SYMLINK+="depth"')
