"""An RPLIDAR A-series sensor as a message source: connect, choose a mode, iterate for the raw chunks of its stream."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Iterator

from drivers.errors import DeviceFaultError, DeviceLostError, DriverError, MotorStalledError
from drivers.messages import LidarStream, Message, RawChunk
from drivers.rplidar_channel import PROBE_BAUDS, RplidarChannel, probe_baud
from drivers.rplidar_modes import ScanModes, read_sample_rate, read_scan_modes
from drivers.rplidar_motor import LidarMotor, MotorControl
from drivers.rplidar_protocol import (
    DEFAULT_PWM,
    PACKET_BYTES,
    Answer,
    Command,
    DeviceInfo,
    Health,
    SampleRate,
    ScanMode,
    express_request,
    parse_health,
    request,
)
from drivers.serial_link import open_serial
from drivers.sources import ByteLink, Closing

_READ_S = 0.1  # also how soon request_stop is noticed
_GATHER_S = 0.02  # between reads: five a turn cost a fraction of what each few bytes by themselves would
_FIRST_DATA_S = 5.0  # the head needs up to 4 s to reach a stable speed
_SILENCE_S = 0.5  # a packet comes every 12 ms at most; with the question after it, told within 1 s
_STILL_THERE_S = 0.2
_BOOT_S = 15.0  # firmware that starts slowly has been seen to need most of it
_BOOT_POLL_S = 0.2


def open_rplidar(
    port: str,
    *,
    baud: int | None = None,
    motor: MotorControl = MotorControl.AUTO,
    clock: Callable[[], int] = time.monotonic_ns,
) -> Rplidar:
    """Open the sensor on `port` (path or pyserial URL); see connect."""
    return connect(lambda rate: open_serial(port, rate), clock=clock, baud=baud, motor=motor, port=port)


def connect(
    open_link: Callable[[int], ByteLink],
    *,
    clock: Callable[[], int],
    baud: int | None = None,
    motor: MotorControl = MotorControl.AUTO,
    sleep: Callable[[float], None] = time.sleep,
    port: str = "lidar",
) -> Rplidar:
    """Find the sensor on the link that open_link(baud) gives, probing the usual speeds when baud is None.

    clock: ns, never stepping back; it stamps the chunks and measures time-outs. port: how errors name the link.
    Raises what open_link raises, SilentPortError, WrongBaudError or DeviceLostError; the link is closed then.
    """
    bauds = PROBE_BAUDS if baud is None else (baud,)
    link = open_link(bauds[0])
    try:
        channel = RplidarChannel(link, clock, sleep)
        found = probe_baud(channel, bauds, port)
    except BaseException:
        link.close()
        raise
    return Rplidar(channel, *found, LidarMotor(channel, motor, sleep), clock=clock, sleep=sleep, port=port)


class Rplidar(Closing):
    """A connected sensor. Iterating after start() gives the LidarStream, then each read as a RawChunk.

    Questions end a running scan, as they do on the device itself. Scan and motor stop on close(), and if that is never
    called, when the object goes or the interpreter exits.
    """

    def __init__(
        self,
        channel: RplidarChannel,
        baud: int,
        info: DeviceInfo,
        motor: LidarMotor,
        *,
        clock: Callable[[], int],
        sleep: Callable[[float], None],
        port: str,
    ) -> None:
        self.baud = baud
        self._channel = channel
        self._info = info
        self._clock = clock
        self._sleep = sleep
        self._port = port
        self._modes: ScanModes | None = None
        self._motor = motor
        self._stream: LidarStream | None = None
        self._early = RawChunk(0, b"")  # what came together with the stream's descriptor
        self._stop_requested = threading.Event()
        self._shut = weakref.finalize(self, _shut, channel, motor)

    def info(self) -> DeviceInfo:
        """Model, firmware, hardware and serial number, as answered on connecting."""
        return self._info

    def has_motor_board(self) -> bool:
        """Whether an accessory board drives the motor; on a bare UART there is none, and nothing answers for it."""
        self._end_scan()
        return self._motor.has_board()

    def health(self) -> Health:
        """Ask for the device's own verdict on itself."""
        return parse_health(self._ask(request(Command.GET_HEALTH), Answer.HEALTH, 3, "GET_HEALTH"))

    def sample_rate(self) -> SampleRate:
        """Sample times of the two legacy modes."""
        self._end_scan()
        return read_sample_rate(self._channel, self._info)

    def scan_modes(self) -> tuple[ScanMode, ...]:
        """The modes that this device offers and this driver decodes."""
        return self._known_modes().modes

    def typical_mode(self) -> ScanMode:
        """The mode that the device recommends."""
        return self._known_modes().typical

    def start(self, mode: str | None = None, pwm: int = DEFAULT_PWM) -> LidarStream:
        """Turn the motor and begin to scan in the named mode, None for the typical one; restarts a running scan.

        Raises DeviceFaultError for an unknown mode, a protection stop that a reset does not clear, or a refusal.
        """
        chosen = self._known_modes().find(mode)
        self._end_scan()
        self._ensure_healthy()
        self._motor.start(pwm)
        standard = chosen.answer_type == Answer.NODES
        question = request(Command.SCAN) if standard else express_request(chosen.id)
        early = self._channel.begin(question, chosen.answer_type, PACKET_BYTES[Answer(chosen.answer_type)])
        if early is None:
            raise DeviceFaultError(
                f"{self._port}: the lidar does not start mode {chosen.name}: reset it or use another"
            )
        self._early = RawChunk(self._clock(), early)
        self._stream = LidarStream(
            stamp_ns=self._early.stamp_ns,
            model=self._info.model,
            firmware=self._info.firmware_text,
            hardware=self._info.hardware,
            serial=self._info.serial,
            baud=self.baud,
            mode=chosen.name,
            answer_type=chosen.answer_type,
            sample_us=chosen.sample_us,
            range_max_m=chosen.max_distance_m,
        )
        self._stop_requested.clear()
        return self._stream

    def __iter__(self) -> Iterator[Message]:
        """The stream's description and its chunks until request_stop() or stop(); starts the typical mode if none runs.

        Raises MotorStalledError if no data come though the sensor answers, DeviceLostError on unplugging and silence.
        """
        stream = self._stream or self.start()
        yield stream
        flowing = bool(self._early.data)
        if flowing:
            yield self._early
        heard_ns = self._clock()
        while self._stream is stream and not self._stop_requested.is_set():
            data = self._channel.link.read(_READ_S)
            now_ns = self._clock()
            if data:
                yield RawChunk(now_ns, data)
                flowing, heard_ns = True, self._clock()  # the time that the consumer took is not silence
                self._sleep(max(0.0, _GATHER_S - (heard_ns - now_ns) * 1e-9))
            else:
                self._check_silence((now_ns - heard_ns) * 1e-9, flowing)

    def request_stop(self) -> None:
        """End the iteration within 0.2 s; may be called from any thread or a signal handler."""
        self._stop_requested.set()

    def stop(self) -> None:
        """End the scan; the motor keeps turning."""
        self._end_scan()

    def reset(self) -> None:
        """Reboot the device and wait until it answers; DeviceLostError if it does not."""
        self._stream = None
        self._channel.link.write(request(Command.RESET))
        deadline = self._clock() + round(_BOOT_S * 1e9)
        while self._clock() < deadline:
            self._sleep(_BOOT_POLL_S)
            self._channel.drain(_BOOT_POLL_S)
            if self._channel.ask(request(Command.GET_INFO), Answer.INFO, 20, attempts=1):
                return
        raise DeviceLostError(
            f"{self._port}: no answer within {_BOOT_S:.0f} s of a reset: unplug the lidar and plug it in"
        )

    def close(self) -> None:
        """Stop the scan and the motor and release the port; a lost link and a second call are fine."""
        self._stream = None
        self.request_stop()
        self._shut()

    def _known_modes(self) -> ScanModes:
        if self._modes is None:
            self._end_scan()
            self._modes = read_scan_modes(self._channel, self._info)
        return self._modes

    def _end_scan(self) -> None:
        if self._stream is not None:
            self._stream = None
            self._channel.quieten()

    def _ask(self, question: bytes, kind: int, size: int, name: str) -> bytes:
        self._end_scan()
        answer = self._channel.ask(question, kind, size)
        if answer is None:
            raise DeviceLostError(
                f"{self._port}: the lidar no longer answers {name}: check its cable and its 5 V supply"
            )
        return answer

    def _ensure_healthy(self) -> None:
        if not self.health().stopped:
            return
        self.reset()
        health = self.health()
        if health.stopped:
            raise DeviceFaultError(
                f"{self._port}: protection stop, error code 0x{health.error_code:04X}, also after a reset:"
                " free the head, check the 5 V supply, then power-cycle the lidar"
            )

    def _check_silence(self, silent_s: float, flowing: bool) -> None:
        """Raise if it lasts too long, after asking the sensor whether it is still there."""
        if silent_s <= (_SILENCE_S if flowing else _FIRST_DATA_S):
            return
        question = request(Command.GET_HEALTH)
        if self._channel.ask(question, Answer.HEALTH, 3, attempts=1, timeout_s=_STILL_THERE_S) is None:
            raise DeviceLostError(
                f"{self._port}: no data for {silent_s:.1f} s during a scan, and no answer:"
                " check the cable and the 5 V supply"
            )
        raise MotorStalledError(
            f"{self._port}: the lidar answers, but sends no data for {silent_s:.1f} s: the motor does not turn or not"
            " steadily: free the head, check the motor's PWM wire and the 5 V supply"
        )


def _shut(channel: RplidarChannel, motor: LidarMotor) -> None:
    try:
        channel.link.write(request(Command.STOP))
        motor.stop()
    except DriverError:
        pass  # the link is gone: nothing is left to stop
    finally:
        channel.link.close()
