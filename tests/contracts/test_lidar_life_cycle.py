"""What happens around a scan, on a port of the operating system: losses, replugging, crashes, a thousand openings."""

from __future__ import annotations

import contextlib
import gc
import itertools
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.emulated_faults import FaultScript, parse_script
from drivers.errors import DeviceLostError, MotorStalledError
from drivers.faulty_line import FaultyLine
from drivers.messages import LidarStream, RawChunk
from drivers.pty_port import PtyPort
from drivers.reconnecting_lidar import ReconnectingLidar, ReconnectPolicy
from drivers.rplidar import Rplidar, connect, open_rplidar
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from drivers.rplidar_protocol import express_request
from drivers.scan_reader import ScanReader
from drivers.serial_link import SerialLink, open_serial

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals are served on Linux only"),
    pytest.mark.live(cores=1),
]

CRASHING = """
import sys
from drivers.rplidar import open_rplidar
lidar = open_rplidar(sys.argv[1])
lidar.start()
for number, message in enumerate(lidar):
    if number == 20:
        raise ZeroDivisionError
"""


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 3.0)


def serve(script: str = "", link: Path | None = None) -> tuple[RplidarEmulator, PtyPort]:
    faults = FaultScript(parse_script(script))
    device = RplidarEmulator(A2M8, wall, startup_s=0.1, script=faults)
    return device, PtyPort(FaultyLine(device, faults, A2M8.baud), A2M8.baud, link=link)


@pytest.mark.live
def test_unplugging_is_noticed_within_a_fifth_of_a_second() -> None:
    _, port = serve()
    with port, open_rplidar(port.name) as lidar, ScanReader(lidar) as reader:
        assert reader.latest(5.0) is not None
        pulled = time.monotonic()
        port.unplug()
        with pytest.raises(DeviceLostError, match=port.name):
            list(reader)
        assert time.monotonic() - pulled < 0.2


@pytest.mark.live
@pytest.mark.parametrize(("script", "error"), [("silence@1", DeviceLostError), ("motor-stall@1", MotorStalledError)])
def test_silence_is_noticed_within_a_second(script: str, error: type[Exception]) -> None:
    _, port = serve(script)
    heard = [time.monotonic()]

    def read(lidar: Rplidar) -> None:
        for message in lidar:
            if isinstance(message, RawChunk):
                heard[0] = time.monotonic()

    with port, open_rplidar(port.name) as lidar:
        with pytest.raises(error):
            read(lidar)
        assert time.monotonic() - heard[0] < 1.0


def test_a_sensor_that_is_plugged_in_again_goes_on_behind_the_same_path(tmp_path: Path) -> None:
    link = tmp_path / "lidar"
    device, port = serve(link=link)
    policy = ReconnectPolicy(give_up_s=10.0, first_wait_s=0.1)
    with port, ReconnectingLidar(lambda: open_rplidar(str(link)), policy, clock=time.monotonic_ns) as lidar:
        lidar.start("Boost")
        messages = iter(lidar)
        first = list(itertools.islice(messages, 20))
        port.unplug()
        device.power_up(time.monotonic_ns())
        back = threading.Timer(0.5, port.plug_in)
        back.start()
        later = list(itertools.islice(messages, 40))
        back.join()
        modes = [message.mode for message in (*first, *later) if isinstance(message, LidarStream)]
        assert modes == ["Boost", "Boost"]
        assert lidar.losses == 1
        assert isinstance(later[-1], RawChunk)


def test_a_program_that_crashes_leaves_scan_and_motor_stopped(project_root: Path) -> None:
    device, port = serve()
    with port:
        environment = {**os.environ, "PYTHONPATH": str(project_root)}
        ended = subprocess.run(
            [sys.executable, "-c", CRASHING, port.name], env=environment, capture_output=True, text=True, check=False
        )
        assert "ZeroDivisionError" in ended.stderr
        time.sleep(0.2)
        emitted = device.counters.samples_emitted
        assert emitted > 0
        with open_serial(port.name, A2M8.baud) as link:
            link.write(express_request(0))
            time.sleep(0.5)
        assert device.counters.samples_emitted == emitted, "the motor turns"


class Hasty:
    """A link that waits a twentieth as long."""

    def __init__(self, link: SerialLink) -> None:
        self.link = link

    def __getattr__(self, name: str):
        return getattr(self.link, name)

    def read(self, timeout_s: float) -> bytes:
        return self.link.read(timeout_s / 20)


def test_a_thousand_openings_leak_nothing() -> None:
    _, port = serve()

    def cycle(number: int) -> None:
        with connect(
            lambda baud: Hasty(open_serial(port.name, baud)), clock=time.monotonic_ns, sleep=lambda _: None
        ) as lidar:
            if number % 20 == 0:
                lidar.start("Standard")

    def open_files() -> int:
        """What stays open: the server beside opens and closes some of its own, a leak never goes."""
        counts = []
        for _ in range(20):
            counts.append(len(list(Path("/proc/self/fd").iterdir())))
            time.sleep(0.02)
        return min(counts)

    def held() -> tuple[int, int, int]:
        gc.collect()
        return open_files(), threading.active_count(), len(gc.get_objects())

    with port:
        for number in range(40):
            cycle(number)
        before, before_kb = held(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in range(1000):
            cycle(number)
        after, after_kb = held(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert after[:2] == before[:2]
    assert after[2] - before[2] < 100
    assert after_kb - before_kb < 2000


def relay(server: socket.socket, path: str) -> None:
    """Pass bytes between one client and a port until either goes."""
    client, _ = server.accept()
    with client, open_serial(path, A2M8.baud) as link, contextlib.suppress(OSError, DeviceLostError):
        client.settimeout(0.01)
        while True:
            try:
                heard = client.recv(4096)
                if not heard:
                    return
                link.write(heard)
            except TimeoutError:
                pass
            client.sendall(link.read(0.01))


def test_a_sensor_behind_a_socket() -> None:
    _, port = serve()
    with port, socket.create_server(("127.0.0.1", 0)) as server:
        relaying = threading.Thread(target=relay, args=(server, port.name))
        relaying.start()
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with open_rplidar(url) as lidar, ScanReader(lidar) as reader:
            scans = list(itertools.islice(reader, 5))
            assert (lidar.info().model, lidar.baud) == ("A2M8", 115200)
            port.unplug()
            with pytest.raises(DeviceLostError, match="socket://"):
                list(reader)
        relaying.join()
    assert scans[-1].complete
