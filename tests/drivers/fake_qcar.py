"""A fake of the calls that drivers.qcar_vehicle makes of Quanser's API: a motor, wheels and sensors in simulated time.

The motor's numbers are made up (5 m/s at full duty, 0.15 s); nothing here was measured on a QCar.
"""

import math
import os
import time
from pathlib import Path

import numpy as np

from drivers.qcar_vehicle import METRES_PER_COUNT

_STEP_S = 0.002
FAKE_API = "tests.drivers.fake_qcar:LoggedQcar"  # for a process of its own
DEADLINE_S = 0.5


class FakeQcar:
    """clock: returns ns; the car moves up to it at each read and write."""

    def __init__(self, clock, *, volts: float = 12.0, gyro_zero: float = 0.02) -> None:
        self._clock = clock
        self._now_ns = clock()
        self._gyro_zero = gyro_zero
        self.batteryVoltage = volts
        self.motorEncoder = np.zeros(1, dtype=np.int32)
        self.gyroscope = np.zeros(3)
        self.accelerometer = np.zeros(3)
        self.speed_mps = self.way_m = self.yaw_rad = self.throttle = self.steering_rad = 0.0
        self.terminated = False

    def _move(self) -> None:
        while self._now_ns < self._clock():
            self._now_ns += round(_STEP_S * 1e9)
            self.speed_mps += (5.0 * self.throttle - self.speed_mps) * _STEP_S / 0.15
            if self.throttle == 0.0 and abs(self.speed_mps) < 0.01:
                self.speed_mps = 0.0  # the gears' friction
            self.way_m += self.speed_mps * _STEP_S
            self.yaw_rad += self.yaw_rate_radps * _STEP_S

    @property
    def yaw_rate_radps(self) -> float:
        return self.speed_mps * math.tan(self.steering_rad) / 0.256

    def read(self) -> None:
        self._move()
        self.motorEncoder = np.array([math.floor(self.way_m / METRES_PER_COUNT)], dtype=np.int32)
        self.gyroscope = np.array([0.0, 0.0, self.yaw_rate_radps + self._gyro_zero])
        self.accelerometer = np.array([0.0, 0.0, 9.81])

    def write(self, throttle: float, steering: float) -> None:
        self._move()
        self.throttle = min(max(throttle, -0.3), 0.3)
        self.steering_rad = min(max(steering, -0.6), 0.6)

    def terminate(self) -> None:
        self.write(0.0, 0.0)
        self.terminated = True


class LoggedQcar(FakeQcar):
    """As Quanser's QCar is made, in real time; each write goes to the file FAKE_QCAR_LOG as: time in s, throttle."""

    def __init__(self, readMode: int, pwmLimit: float) -> None:  # Quanser's names
        assert (readMode, pwmLimit) == (0, 0.3)
        self._log = Path(os.environ["FAKE_QCAR_LOG"])
        super().__init__(time.monotonic_ns, volts=float(os.environ.get("FAKE_QCAR_VOLTS", "12")))
        print("Quanser's API prints")  # noqa: T201 - as the real one does

    def write(self, throttle: float, steering: float) -> None:
        super().write(throttle, steering)
        with self._log.open("a") as log:
            log.write(f"{time.monotonic():.4f} {throttle}\n")

    def terminate(self) -> None:
        super().terminate()
        with self._log.open("a") as log:
            log.write(f"{time.monotonic():.4f} terminated\n")
