"""Notices to a service manager, received on a socket as systemd has one."""

from __future__ import annotations

import os
import re
import signal
import socket
import threading
import time

import numpy as np
import pytest

from drivers.pty_port import PtyPort
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from mapping.mount import Mount
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from tools.clock import RunClock
from tools.emulation import Drive, simulated_lidar
from tools.service_notice import ServiceNotice, service_notices
from tools.session_parts import LiveSession


class ServiceManager:
    """Its end of the socket."""

    def __init__(self, address):
        self._link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._link.bind(address)
        self._link.setblocking(False)

    def heard(self):
        """The datagrams that have come, each as a dict."""
        told: list[dict[str, str]] = []
        while True:
            try:
                datagram = self._link.recv(4096).decode()
            except BlockingIOError:
                return told
            told.append(dict(line.split("=", 1) for line in datagram.splitlines()))

    def close(self):
        self._link.close()


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    if request.param == "path":
        address = str(tmp_path / "notify")
        manager = ServiceManager(address)
    else:
        address = f"@mapfuse-robot-test-{os.getpid()}"
        manager = ServiceManager("\0" + address[1:])
    yield manager, address
    manager.close()


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def mapped():
    pose = np.array([1.0, -2.0, 0.5])
    return MappedScan(0, pose, ScanMatch(pose, np.zeros(3), accepted=True), np.zeros((0, 2)), False, False)


def session():
    return LiveSession(RunClock(), Mount(), lambda _: None, threading.Event())


def test_it_is_ready_with_the_first_scan_and_not_before(manager, mapped, tmp_path):
    systemd, address = manager
    notice = ServiceNotice(address)
    notice.begin(session())
    notice.note(mapped)
    assert not any("READY" in told for told in systemd.heard())
    notice.add(mapped)
    notice.add(mapped)
    (told,) = systemd.heard()
    assert told == {"READY": "1", "STATUS": "mapping: 1 scans, the car is at x 1.00 m, y -2.00 m"}
    notice.end()
    assert systemd.heard()[-1]["STOPPING"] == "1"
    assert notice.save(tmp_path) == {}


def test_it_is_alive_while_scans_are_mapped_and_only_then(manager, mapped):
    systemd, address = manager
    clock = Clock()
    notice = ServiceNotice(address, 8.0, clock=clock)
    for _ in range(100):  # 10 s
        notice.add(mapped)
        clock.now += 0.1
    told = systemd.heard()
    assert [one for one in told if "WATCHDOG" in one] == [one for one in told if one.get("WATCHDOG") == "1"]
    assert 4 <= sum("WATCHDOG" in one for one in told) <= 6  # four times a watchdog
    lines = [one["STATUS"] for one in told if "STATUS" in one]
    assert 4 <= len(lines) <= 6  # each 2 s
    assert all(re.fullmatch(r"mapping: \d+ scans, the car is at x 1.00 m, y -2.00 m", line) for line in lines)
    clock.now += 20.0
    for _ in range(100):
        notice.note(mapped)  # the sensor goes on, the thread that maps is stuck
    assert systemd.heard() == []


def test_the_environment_says_who_listens():
    assert service_notices({}) == ()
    assert service_notices({"WATCHDOG_USEC": "1000000"}) == ()


@pytest.mark.parametrize(
    ("asked", "alive"),
    [
        ({"WATCHDOG_USEC": "4000000"}, True),
        ({"WATCHDOG_USEC": "4000000", "WATCHDOG_PID": str(os.getpid())}, True),
        ({"WATCHDOG_USEC": "4000000", "WATCHDOG_PID": "1"}, False),
        ({"WATCHDOG_USEC": "0"}, False),
        ({"WATCHDOG_USEC": "soon"}, False),
        ({}, False),
    ],
)
def test_the_watchdog_is_answered_where_it_watches_this_process(asked, alive, manager, mapped):
    systemd, address = manager
    (notice,) = service_notices({"NOTIFY_SOCKET": address, **asked})
    notice.add(mapped)
    (told,) = systemd.heard()
    assert ("WATCHDOG" in told) == alive


def test_a_drive_is_told_too(manager, mapped):
    systemd, address = manager
    (notice,) = service_notices({"NOTIFY_SOCKET": address}, lambda: "driving to goal 1: 2.0 m to go")
    notice.add(mapped)
    assert systemd.heard()[0]["STATUS"].endswith("y -2.00 m; driving to goal 1: 2.0 m to go")


def test_nobody_who_listens_is_no_fault(tmp_path, mapped):
    notice = ServiceNotice(str(tmp_path / "gone"), 1.0)
    notice.begin(session())
    notice.add(mapped)
    notice.end()


@pytest.mark.live(cores=1)
def test_a_run_tells_its_service_manager_from_the_first_scan_to_the_end(cli, tmp_path, monkeypatch):
    address = str(tmp_path / "notify")
    systemd = ServiceManager(address)
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    told: list[dict[str, str]] = []

    def end_after_some_scans():
        while sum("WATCHDOG" in one for one in told) < 3:
            time.sleep(0.05)
            told.extend(systemd.heard())
        os.kill(os.getpid(), signal.SIGINT)

    lidar = simulated_lidar("office", Drive.tour("office"), noise=True, seed=3)
    watcher = threading.Thread(target=end_after_some_scans, daemon=True)
    watcher.start()
    with PtyPort(RplidarEmulator(A2M8, lidar, startup_s=-0.2), A2M8.baud) as port:
        ended = cli("run", "--lidar", port.name, "--no-record", "-o", tmp_path / "run")
    assert ended.code == 0, ended.err
    watcher.join()
    told.extend(systemd.heard())
    systemd.close()
    assert [list(one) for one in told[:2]] == [["STATUS"], ["READY", "WATCHDOG", "STATUS"]]
    assert sum("READY" in one for one in told) == 1
    assert told[-1] == {"STOPPING": "1", "STATUS": "saving and refining the map"}
