"""The host driver against the emulator, in simulated time."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulated_faults import FaultScript, parse_script
from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import (
    DeviceFaultError,
    DeviceLostError,
    DriverError,
    MotorStalledError,
    SilentPortError,
    WrongBaudError,
)
from drivers.faulty_line import FaultyLine
from drivers.messages import LaserScan, LidarStream, RawChunk
from drivers.rplidar import Rplidar, connect
from drivers.rplidar_decoder import RplidarDecoder
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8, A2M12, EmulatedModel
from drivers.rplidar_motor import MotorControl
from drivers.rplidar_protocol import Command, Health, SampleRate, express_request, request

MODELS = [A2M8, A2M12]


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 3.0)


class SilencedLink(EmulatedLink):
    """From silence() on nothing arrives."""

    silent = False

    def silence(self) -> None:
        self.silent = True

    def read(self, timeout_s: float) -> bytes:
        data = super().read(timeout_s)
        return b"" if self.silent else data


class Bench:
    """An emulator, a simulated clock and every link that was opened to it."""

    def __init__(self, model: EmulatedModel = A2M8, **options) -> None:
        self.clock = SimulatedClock(5_000_000_000)
        self.device = RplidarEmulator(model, wall, **options)
        self.line = FaultyLine(self.device, options.get("script") or FaultScript(), model.baud)
        self.links: list[SilencedLink] = []
        self.lines: dict[str, bool] = {}

    def open(self, baud: int) -> SilencedLink:
        on_line = self.lines.__setitem__
        self.links.append(SilencedLink(self.line, self.clock, self.device.model.baud, baud, on_line=on_line))
        return self.links[-1]

    def connect(self, baud: int | None = None, motor: MotorControl = MotorControl.AUTO) -> Rplidar:
        return connect(self.open, clock=self.clock, baud=baud, motor=motor, sleep=self.clock.sleep, port="bench")

    def collect(self, lidar: Rplidar, seconds: float) -> tuple[list[LaserScan], RplidarDecoder]:
        """Iterate for so long and decode."""
        end_ns = self.clock() + round(seconds * 1e9)
        messages = iter(lidar)
        stream = next(messages)
        assert isinstance(stream, LidarStream)
        decoder = RplidarDecoder(stream)
        scans: list[LaserScan] = []
        for message in messages:
            assert isinstance(message, RawChunk)
            scans += decoder.feed(message)
            if self.clock() >= end_ns:
                lidar.request_stop()
        return scans, decoder


class Dead:
    """A device that says what it is told to every 10 ms, whatever it hears."""

    def __init__(self, says: bytes = b"") -> None:
        self.says = says
        self.next_ns = 0

    def receive(self, data: bytes, now_ns: int) -> bytes:
        return b""

    def due(self, now_ns: int) -> bytes:
        if now_ns < self.next_ns:
            return b""
        self.next_ns = now_ns + 10_000_000
        return self.says


@pytest.mark.parametrize("model", MODELS)
def test_probing_finds_each_model_on_one_open_port(model: EmulatedModel) -> None:
    bench = Bench(model)
    with bench.connect() as lidar:
        assert lidar.info().model == model.name
        assert lidar.baud == model.baud
        assert lidar.health() == Health(0, 0)
        assert lidar.sample_rate() == SampleRate(500, 250)
        assert lidar.scan_modes() == model.modes
        assert lidar.typical_mode().name == "Sensitivity"
    assert len(bench.links) == 1
    assert bench.links[0].closed


@pytest.mark.parametrize(
    ("model", "mode"), [(model, mode.name) for model in MODELS for mode in model.modes] + [(A2M8, None)]
)
def test_every_mode_delivers_what_was_emitted(model: EmulatedModel, mode: str | None) -> None:
    bench = Bench(model)
    with bench.connect() as lidar:
        stream = lidar.start(mode)
        assert (stream.model, stream.mode, stream.baud) == (model.name, mode or "Sensitivity", model.baud)
        assert stream.range_max_m == 12.0
        scans, decoder = bench.collect(lidar, 3.0)
        assert decoder.counters.samples == pytest.approx(bench.device.counters.samples_emitted, rel=0.01)
        assert decoder.counters.valid_samples == decoder.counters.samples
        assert decoder.counters.rejected_packets == decoder.counters.resync_bytes == 0
        assert [scan.complete for scan in scans[1:]] == [True] * (len(scans) - 1)
        assert len(scans) > 20
        assert all(np.abs(scan.ranges_m - 3.0).max() < 0.005 for scan in scans)


def test_stop_and_restart_in_another_mode() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        lidar.start("Express")
        bench.collect(lidar, 1.0)
        lidar.stop()
        lidar.start("standard")
        scans, decoder = bench.collect(lidar, 1.0)
        assert scans[-1].intensities is not None
        lidar.start("Boost")  # without a stop between
        scans, decoder = bench.collect(lidar, 1.0)
        assert decoder.counters.resync_bytes == 0
        assert scans[-1].complete


def test_iterating_starts_the_typical_mode() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        stream = next(iter(lidar))
    assert isinstance(stream, LidarStream)
    assert stream.mode == "Sensitivity"


@pytest.mark.parametrize("model", MODELS)
def test_a_sensor_that_still_scans_is_taken_over(model: EmulatedModel) -> None:
    bench = Bench(model)
    bench.device.receive(express_request(3), bench.clock())
    bench.clock.sleep(2.0)
    with bench.connect() as lidar:
        lidar.start()
        scans, decoder = bench.collect(lidar, 1.0)
        assert decoder.counters.resync_bytes == 0
        assert scans[-1].complete


def test_a_boot_banner_is_skipped() -> None:
    bench = Bench()
    bench.device.receive(request(Command.RESET), bench.clock())
    with bench.connect() as lidar:
        assert lidar.info().model == "A2M8"


def test_a_silent_port() -> None:
    clock = SimulatedClock()
    links: list[EmulatedLink] = []

    def open_link(baud: int) -> EmulatedLink:
        links.append(EmulatedLink(Dead(), clock, 115200, baud))
        return links[-1]

    with pytest.raises(SilentPortError, match="p0: nothing answers at 115200 and 256000"):
        connect(open_link, clock=clock, sleep=clock.sleep, port="p0")
    with pytest.raises(SilentPortError, match="at 9600 baud: omit the baud rate"):
        connect(open_link, clock=clock, sleep=clock.sleep, port="p0", baud=9600)
    assert all(link.closed for link in links)


def test_a_wrong_baud_rate_while_the_sensor_scans() -> None:
    bench = Bench(A2M12)
    bench.device.receive(express_request(3), bench.clock())
    bench.clock.sleep(1.0)
    with pytest.raises(WrongBaudError, match="115200 baud make no sense.*256000"):
        bench.connect(115200)
    assert bench.links[0].closed


def test_another_device_on_the_port() -> None:
    clock = SimulatedClock()
    gps = Dead(b"$GPGGA,092750.000,5321.6802,N*76\r\n")
    with pytest.raises(WrongBaudError, match="another device"):
        connect(lambda baud: EmulatedLink(gps, clock, baud, baud), clock=clock, sleep=clock.sleep)


def test_an_unknown_mode_lists_the_known_ones() -> None:
    with (
        Bench().connect() as lidar,
        pytest.raises(DeviceFaultError, match="'Turbo'.*Standard .2000 samples/s, 12 m, 0x81., Express"),
    ):
        lidar.start("Turbo")


def test_unplugging_ends_the_iteration_with_an_error_and_close_still_works() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        lidar.start()
        messages = iter(lidar)
        for _ in range(5):
            next(messages)
        bench.links[0].unplug()
        with pytest.raises(DeviceLostError):
            list(messages)
    lidar.close()


def test_silence_during_a_scan_is_a_loss() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        lidar.start()
        messages = iter(lidar)
        for _ in range(5):
            next(messages)
        bench.links[0].silence()
        before_ns = bench.clock()
        with pytest.raises(DeviceLostError, match="no data for 0.* no answer"):
            list(messages)
        assert bench.clock() - before_ns < 1e9


def test_a_sensor_that_answers_but_does_not_measure_any_more_is_not_called_lost() -> None:
    bench = Bench(script=FaultScript(parse_script("motor-stall@2")))
    with bench.connect() as lidar:
        lidar.start()
        with pytest.raises(MotorStalledError, match="answers, but sends no data"):
            list(lidar)
        assert 2e9 < bench.clock() - 5e9 < 5e9


def test_a_slow_consumer_is_not_silence() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        lidar.start()
        messages = iter(lidar)
        for _ in range(5):
            next(messages)
            bench.clock.sleep(3.0)
        assert isinstance(next(messages), RawChunk)


def test_a_motor_that_does_not_turn() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        lidar.start(pwm=0)
        with pytest.raises(DeviceFaultError, match="motor"):
            list(lidar)


def test_a_protection_stop_is_reset_once() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        bench.device.trip_protection(0x8001)
        lidar.start()
        assert bench.collect(lidar, 1.0)[0]
        bench.device.trip_protection(0x8001, outlives_reset=True)
        with pytest.raises(DeviceFaultError, match="protection stop, error code 0x8001"):
            lidar.start()


def test_reset_answers_again() -> None:
    with Bench().connect() as lidar:
        lidar.start()
        lidar.reset()
        assert lidar.health() == Health(0, 0)


def test_closing_stops_scan_and_motor() -> None:
    bench = Bench()
    lidar = bench.connect()
    lidar.start()
    lidar.close()
    lidar.close()
    bench.device.receive(express_request(3), bench.clock())
    assert bench.device.due(bench.clock() + 5_000_000_000) == b""


def test_a_sensor_that_nobody_closes_is_stopped_when_it_is_forgotten() -> None:
    bench = Bench()
    lidar = bench.connect()
    lidar.start()
    del lidar
    gc.collect()
    assert bench.links[0].closed
    bench.device.receive(express_request(3), bench.clock())
    assert bench.device.due(bench.clock() + 5_000_000_000) == b""


@pytest.mark.parametrize(
    ("motor", "turning", "stopped"),
    [
        (MotorControl.AUTO, {"dtr": False}, {"dtr": True}),
        (MotorControl.DTR, {"dtr": False}, {"dtr": True}),
        (MotorControl.RTS, {"dtr": False, "rts": False}, {"dtr": False, "rts": True}),
        (MotorControl.EXTERNAL, {"dtr": False}, {"dtr": False}),
    ],
)
def test_on_a_bare_uart_a_line_switches_the_motor_or_nobody_does(motor, turning, stopped) -> None:
    bench = Bench(board=False)
    with bench.connect(motor=motor) as lidar:
        assert not lidar.has_motor_board()
        lidar.start()
        assert bench.lines == turning
        assert bench.collect(lidar, 1.0)[0]
    assert bench.lines == stopped


def test_with_the_board_the_lines_stay_clear() -> None:
    bench = Bench()
    with bench.connect() as lidar:
        assert lidar.has_motor_board()
        lidar.start()
    assert bench.lines == {"dtr": False}


@pytest.mark.parametrize(
    "script",
    [
        "slow=0.4",
        "slow=0.7",
        "latency=0.016",
        "chunk=3",
        "drop=0.0003@0",
        "flip=0.0003@0",
        "banner@0.2",
        "latency=0.01\nchunk=20",
    ],
)
def test_a_bad_line_costs_time_and_samples_but_not_the_scan(script: str) -> None:
    bench = Bench(script=FaultScript(parse_script(script), 3))
    with bench.connect() as lidar:
        assert lidar.info().model == "A2M8"
        assert [mode.name for mode in lidar.scan_modes()] == [mode.name for mode in A2M8.modes]
        lidar.start("Express")
        scans, _ = bench.collect(lidar, 3.0)
    good = [scan for scan in scans if scan.complete]
    assert len(good) > 5
    assert all(np.abs(scan.ranges_m[scan.valid] - 3.0).max() < 0.005 for scan in good)


def test_firmware_that_does_not_list_its_modes_falls_back_without_asking() -> None:
    for model, script in ((A2M8.with_firmware((1, 20)), ""), (A2M8, "mute=GET_LIDAR_CONF")):
        bench = Bench(model, script=FaultScript(parse_script(script)))
        with bench.connect() as lidar:
            stream = lidar.start()
            assert (stream.mode, stream.sample_us) == ("Express", 250.0)
            assert bench.collect(lidar, 1.0)[0]


FAULTS = st.sampled_from(
    [
        "flip=0.01",
        "drop=0.01",
        "chunk=5",
        "latency=0.03",
        "stall@1+0.3",
        "stall@1+2",
        "silence@1+0.2",
        "silence@1+2",
        "motor-stall@1+1",
        "health=error:5",
        "health=error:5:stays",
        "health=error:9@1",
        "slow=0.3",
        "slow=0.8",
        "mute=GET_INFO",
        "mute=GET_LIDAR_CONF",
        "mute=SCAN",
        "mute=GET_HEALTH",
        "mute=EXPRESS_SCAN",
        "mute=SET_PWM",
        "banner@1",
        "reboot@1",
        "invalid=1",
        "drift=0.4:1",
    ]
)


@settings(max_examples=25)
@given(st.lists(FAULTS, min_size=1, max_size=3, unique=True), st.booleans(), st.sampled_from(list(MotorControl)))
def test_whatever_goes_wrong_ends_in_scans_or_in_one_clear_line(faults: list[str], board: bool, motor) -> None:
    bench = Bench(script=FaultScript(parse_script("\n".join(faults))), board=board)
    said = ""
    try:
        with bench.connect(motor=motor) as lidar:
            lidar.start()
            bench.collect(lidar, 2.5)
    except DriverError as error:
        said = str(error)
    assert said == "" or (len(said) > 30 and "\n" not in said)
    assert bench.links[-1].closed
    assert bench.clock() < 5e9 + 45e9
