from __future__ import annotations

import re
from pathlib import Path

import pytest

from drivers.errors import PortMissingError
from drivers.serial_names import autopilot_rules, stable_path, udev_rule


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    by_id, by_path = tmp_path / "by-id", tmp_path / "by-path"
    for folder in (by_id, by_path):
        folder.mkdir()
    for name in ("ttyUSB0", "ttyUSB1", "ttyTHS1"):
        (tmp_path / name).touch()
    (by_id / "usb-Silicon_Labs_0001-if00").symlink_to("../ttyUSB1")
    for number in (0, 1):
        (by_path / f"usb-{number}").symlink_to(f"../ttyUSB{number}")
    return by_id, by_path


@pytest.mark.parametrize(
    ("port", "stable"),
    [
        ("ttyUSB1", "by-id/usb-Silicon_Labs_0001-if00"),
        ("ttyUSB0", "by-path/usb-0"),
        ("ttyTHS1", "ttyTHS1"),
        ("by-path/usb-1", "by-path/usb-1"),
        ("ttyUSB9", "ttyUSB9"),
    ],
)
def test_the_serial_number_s_link_is_preferred(port: str, stable: str, folders, tmp_path: Path) -> None:
    assert stable_path(str(tmp_path / port), folders) == str(tmp_path / stable)


def test_a_url_stays_as_it_is(folders) -> None:
    assert stable_path("socket://car:2000", folders) == "socket://car:2000"


def test_a_rule_names_the_adapter() -> None:
    rule = udev_rule(None, "lidar")
    assert rule == (
        'SUBSYSTEM=="tty", ATTRS{idVendor}=="10c4", ATTRS{idProduct}=="ea60", GROUP="dialout", MODE="0660",'
        ' ENV{ID_MM_DEVICE_IGNORE}="1", SYMLINK+="lidar"'
    )


def test_an_autopilot_is_named_by_any_of_its_usb_numbers_and_only_its_first_port() -> None:
    rules = autopilot_rules("vehicle").splitlines()
    assert [re.findall(r'ATTRS{id(\w+)}=="(\w+)"', rule) for rule in rules] == [
        [("Vendor", "26ac")],
        [("Vendor", "1209"), ("Product", "5740")],
        [("Vendor", "1209"), ("Product", "5741")],
    ]
    for rule in rules:
        assert rule.startswith('SUBSYSTEM=="tty", ')
        assert 'ENV{ID_USB_INTERFACE_NUM}=="00", GROUP="dialout"' in rule
        assert rule.endswith('ENV{ID_MM_DEVICE_IGNORE}="1", SYMLINK+="vehicle"')


def test_no_rule_for_what_is_not_there() -> None:
    with pytest.raises(PortMissingError, match="ttyNone"):
        udev_rule("/dev/ttyNone", "lidar")
