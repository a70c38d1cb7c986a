"""An emulated car in this process, driven by whoever connects in real time; what becomes of it is known to the ms."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.datagram_link import DatagramLink
from drivers.emulated_faults import Fault, FaultKind, FaultScript
from drivers.rover_faults import RoverFaultKind
from drivers.rplidar_models import MODELS
from tools.car_emulation import CarWanted, EmulatedVehicle
from tools.drive_scores import Stop, TrueDrive, stop_after
from tools.rover_emulation import serve_over_network

FloatArray = NDArray[np.float64]
_MODEL = "A2M8"
_FAST_MPS = 0.2
_STANDING_MPS = 1e-3
_SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"


class WatchedCar:
    """An emulated car that is served by a thread; keeps when which setpoint came in. address: of its vehicle."""

    def __init__(self, world: str, pose: FloatArray, link: Path, seed: int) -> None:
        x, y, yaw = pose.tolist()
        self._script = FaultScript()
        wanted = CarWanted(world, (x, y, yaw), MODELS[_MODEL], link, self._script, seed=seed)
        self.emulated = EmulatedVehicle(wanted)
        self._network = DatagramLink("127.0.0.1", 0, listen=True)
        self.address = f"udpout:127.0.0.1:{self._network.port}"
        self.setpoints: list[tuple[int, float]] = []  # the emulated clock's ns, m/s
        self._count = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="car", daemon=True)
        self._thread.start()

    def now_ns(self) -> int:
        """Return the emulated world's time."""
        return self.emulated.clock()

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """See drivers.emulated_link.EmulatedDevice."""
        answers = self.emulated.car.receive(data, now_ns)
        rover = self.emulated.rover
        if rover.received[_SETPOINT] != self._count:
            self._count = rover.received[_SETPOINT]
            self.setpoints.append((now_ns, float(rover.last[_SETPOINT].vx)))
        return answers

    def due(self, now_ns: int) -> bytes:
        """Likewise."""
        return self.emulated.car.due(now_ns)

    def power_up(self, now_ns: int) -> None:
        """It has a battery."""

    def silence_lidar(self) -> None:
        """From now on no byte of the lidar arrives."""
        self._script.add(Fault(FaultKind.SILENCE))

    def blind_lidar(self) -> None:
        """From now on its scans come as before, and show nothing: a covered window."""
        self._script.add(Fault(FaultKind.INVALID, (1.0,)))

    def cut_link(self) -> None:
        """From now on nothing comes from or goes to the vehicle."""
        self.emulated.rover.begin(RoverFaultKind.CUT)

    @property
    def speed_mps(self) -> float:
        """How fast it truly is."""
        return abs(self.emulated.rover.state.speed_mps)

    @property
    def stands(self) -> bool:
        """Whether it does."""
        return self.speed_mps <= _STANDING_MPS

    @property
    def is_driven(self) -> bool:
        """Whether it drives fast, and is told to."""
        return self.speed_mps > _FAST_MPS and abs(self.setpoints[-1][1]) > _FAST_MPS

    def stop_after(self, event_ns: int) -> Stop:
        """Measure a stop by the truth; commands count when they arrive."""
        stamps_ns, poses, speeds = self.emulated.world.truth
        truth = TrueDrive(np.asarray(stamps_ns * 1e-9, dtype=np.float64), poses, poses, speeds)
        return stop_after(truth, [(at_ns * 1e-9, mps) for at_ns, mps in self.setpoints], event_ns * 1e-9)

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self._thread.join()
        self._network.close()

    def _serve(self) -> None:
        with self.emulated.sensor.port:
            while not self._ended.is_set():
                serve_over_network(self, self._network, self.emulated.clock)
