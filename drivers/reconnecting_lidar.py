"""An RPLIDAR that may be unplugged for a while: opened again by the same path, it goes on in the same mode."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from drivers.errors import DeviceLostError, DriverError, MotorStalledError, WrongDeviceError
from drivers.messages import LidarStream, Message
from drivers.rplidar import Rplidar
from drivers.rplidar_protocol import DEFAULT_PWM
from drivers.sources import Closing


@dataclass(frozen=True, slots=True)
class ReconnectPolicy:
    """How long to try after a loss, 0 for not at all, and how long to wait before the first and between later tries."""

    give_up_s: float = 10.0
    first_wait_s: float = 0.2
    longest_wait_s: float = 2.0


class ReconnectingLidar(Closing):
    """Iterates like an Rplidar; after a loss the new stream's LidarStream comes first, then its chunks.

    open_lidar: opens the sensor; name a path that stays the same, see drivers.serial_names.stable_path. clock: ns.
    wait: lets seconds pass and tells whether to stop; the default waits for request_stop(). tell: gets a line for each
    loss and return.
    """

    def __init__(
        self,
        open_lidar: Callable[[], Rplidar],
        policy: ReconnectPolicy,
        *,
        clock: Callable[[], int],
        wait: Callable[[float], bool] | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.losses = 0
        self._open_lidar = open_lidar
        self._policy = policy
        self._clock = clock
        self._stop = threading.Event()
        self._wait = wait or self._stop.wait
        self._tell = tell
        self._mode: str | None = None
        self._pwm = DEFAULT_PWM
        self._lidar = open_lidar()

    @property
    def lidar(self) -> Rplidar:
        """The sensor as it is connected now, for questions before start()."""
        return self._lidar

    def start(self, mode: str | None = None, pwm: int = DEFAULT_PWM) -> LidarStream:
        """See Rplidar.start; the mode and the duty are those that are resumed."""
        stream = self._lidar.start(mode, pwm)
        self._mode, self._pwm = stream.mode, pwm
        self._stop.clear()
        return stream

    def __iter__(self) -> Iterator[Message]:
        """The stream's description and chunks until request_stop(); raises what ended it if that does not pass in time.

        Also if the sensor is still lost when a stop is requested.
        """
        while True:
            try:
                yield from self._lidar
            except (DeviceLostError, MotorStalledError) as error:
                if self._stop.is_set():
                    return
                self._regain(error)
            else:
                return

    def request_stop(self) -> None:
        """End the iteration within 0.2 s, also while waiting for the sensor; from any thread or a signal handler."""
        self._stop.set()
        self._lidar.request_stop()

    def close(self) -> None:
        """Stop scan and motor and release the port; closing twice is allowed."""
        self.request_stop()
        self._lidar.close()

    def _regain(self, loss: DriverError) -> None:
        """Open the sensor again and start it; raise when time is up or a stop is requested before."""
        policy, serial = self._policy, self._lidar.info().serial
        self._lidar.close()
        if policy.give_up_s <= 0:
            raise loss
        self.losses += 1
        self._tell(f"{loss}; trying again for {policy.give_up_s:g} s")
        lost_ns = self._clock()
        wait_s = policy.first_wait_s
        while not self._wait(wait_s):
            try:
                self._reopen(serial)
            except WrongDeviceError:
                raise
            except DriverError as error:
                if (self._clock() - lost_ns) * 1e-9 > policy.give_up_s:
                    raise DeviceLostError(f"{loss}; not back within {policy.give_up_s:g} s: {error}") from error
                wait_s = min(2.0 * wait_s, policy.longest_wait_s)
            else:
                self._tell(f"the lidar is back after {(self._clock() - lost_ns) * 1e-9:.1f} s, in mode {self._mode}")
                return
        raise loss

    def _reopen(self, serial: str) -> None:
        lidar = self._open_lidar()
        try:
            found = lidar.info().serial
            if found != serial:
                raise WrongDeviceError(f"another lidar, serial {found}, is where {serial} was: put that one back")
            lidar.start(self._mode, self._pwm)
        except BaseException:
            lidar.close()
            raise
        self._lidar = lidar
        if self._stop.is_set():  # asked of the former one
            lidar.request_stop()
