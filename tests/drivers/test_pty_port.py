"""The emulator on a pseudo-terminal: bare clients in turn, the driver end to end, wrong speeds, unplugging."""

from __future__ import annotations

import os
import select
import sys
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DeviceLostError, DriverError, SilentPortError, WrongBaudError
from drivers.messages import RawChunk
from drivers.pty_port import PtyPort
from drivers.rplidar import open_rplidar
from drivers.rplidar_decoder import RplidarDecoder
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8, A2M12, EmulatedModel
from drivers.rplidar_protocol import Command, express_request, request

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals are served on Linux only"),
    pytest.mark.live(cores=1),
]


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 3.0)


def serve(model: EmulatedModel = A2M8, link: Path | None = None) -> tuple[RplidarEmulator, PtyPort]:
    device = RplidarEmulator(model, wall, startup_s=0.1)
    return device, PtyPort(device, model.baud, link=link)


def read_until(descriptor: int, count: int, limit_s: float = 3.0) -> bytes:
    data, deadline = b"", time.monotonic() + limit_s
    while len(data) < count and time.monotonic() < deadline:
        if select.select([descriptor], [], [], 0.1)[0]:
            data += os.read(descriptor, 4096)
    return data


@pytest.mark.parametrize("model", [A2M8, A2M12])
def test_bare_clients_in_turn(model: EmulatedModel) -> None:
    _, port = serve(model)
    with port:
        for client in range(4):
            descriptor = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
            if client == 1:
                tty.setraw(descriptor)
            os.write(descriptor, request(Command.GET_INFO))
            answer = read_until(descriptor, 27)
            assert answer[:8] == bytes.fromhex("A55A1400000004") + bytes([model.model_id])
            assert len(answer) == 27
            if client == 2:  # leaves an unread answer and cooked settings behind
                tty.setcbreak(descriptor)
                os.write(descriptor, request(Command.GET_INFO))
                time.sleep(0.1)
            os.close(descriptor)
            time.sleep(0.1)


def test_the_scan_outlives_its_client_and_unread_bytes_are_lost() -> None:
    _, port = serve()
    with port:
        descriptor = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
        os.write(descriptor, express_request(3))
        assert len(read_until(descriptor, 1000)) >= 1000
        os.close(descriptor)
        time.sleep(0.3)
        assert port.bytes_lost > 0
        descriptor = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
        assert len(read_until(descriptor, 1000)) >= 1000
        os.close(descriptor)


@pytest.mark.parametrize("model", [A2M8, A2M12])
def test_the_driver_gets_the_points_that_were_emitted(model: EmulatedModel) -> None:
    device, port = serve(model)
    with port, open_rplidar(port.name) as lidar:
        assert (lidar.info().model, lidar.baud) == (model.name, model.baud)
        decoder = RplidarDecoder(lidar.start())
        end = time.monotonic() + 2.5
        scans = []
        for message in lidar:
            if isinstance(message, RawChunk):
                scans += decoder.feed(message)
            if time.monotonic() > end:
                lidar.request_stop()
        # Two packets are always under way: one on the wire, one held for its successor.
        emitted = device.counters.samples_emitted
        assert emitted * 0.99 - 2 * 96 <= decoder.counters.samples <= emitted
        assert decoder.counters.rejected_packets == 0
        assert any(scan.complete for scan in scans)
        assert port.bytes_lost == 0


def test_a_sensor_that_still_scans_is_taken_over() -> None:
    _, port = serve(A2M12)
    with port:
        descriptor = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
        os.write(descriptor, express_request(3))
        assert read_until(descriptor, 500)
        os.close(descriptor)
        with open_rplidar(port.name) as lidar:
            assert lidar.info().model == "A2M12"


def test_the_wrong_speed_while_scanning_is_noise_and_while_idle_is_silence() -> None:
    _, port = serve(A2M12)
    with port:
        with pytest.raises(SilentPortError, match="115200.*omit"):
            open_rplidar(port.name, baud=115200)
        time.sleep(0.1)  # the line falls back to the sensor's speed
        descriptor = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
        os.write(descriptor, express_request(3))
        assert read_until(descriptor, 500)
        os.close(descriptor)
        time.sleep(0.5)  # again, or it falls back after the next client has set its own
        with pytest.raises(WrongBaudError, match=port.name):
            open_rplidar(port.name, baud=115200)


def test_a_bare_pseudo_terminal_is_silent() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        with pytest.raises(SilentPortError, match="115200 and 256000"):
            open_rplidar(os.ttyname(slave))
    finally:
        os.close(master)
        os.close(slave)


def test_unplugging() -> None:
    _, port = serve()
    with open_rplidar(port.name) as lidar:
        lidar.start()
        messages = iter(lidar)
        for _ in range(5):
            next(messages)
        port.close()
        with pytest.raises(DeviceLostError, match=port.name):
            list(messages)
    port.close()


def test_a_device_that_is_plugged_in_again_is_behind_the_same_link(tmp_path: Path) -> None:
    link = tmp_path / "lidar"
    _, port = serve(link=link)
    with port:
        for _ in range(2):
            with open_rplidar(str(link)) as lidar:
                lidar.start()
                port.unplug()
                assert not link.is_symlink()
                with pytest.raises(DeviceLostError):
                    list(lidar)
            port.plug_in()


def test_a_link_to_the_port(tmp_path: Path) -> None:
    link = tmp_path / "lidar"
    link.symlink_to("/nowhere")
    _, port = serve(link=link)
    with port:
        assert str(link.readlink()) == port.name
        with open_rplidar(str(link)) as lidar:
            assert lidar.info().model == "A2M8"
    assert not link.is_symlink()
    link.write_text("a file")
    with pytest.raises(DriverError, match="lidar: cannot be made a link"):
        serve(link=link)


def test_an_error_of_the_device_reaches_its_owner() -> None:
    def broken(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
        raise ZeroDivisionError("the world has no walls")

    port = PtyPort(RplidarEmulator(A2M8, broken, startup_s=0.0), A2M8.baud)
    descriptor = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
    os.write(descriptor, express_request(0))
    time.sleep(0.2)
    os.close(descriptor)
    with pytest.raises(ZeroDivisionError, match="no walls"):
        port.close()
