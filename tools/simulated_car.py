"""A MAVLink rover in a world, on a simulated clock, and our link to it: the same bytes as on a wire, and one truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.emulated_link import EmulatedDevice, EmulatedLink, SimulatedClock
from drivers.mavlink_codec import MavlinkCodec
from drivers.mavlink_rover import MavlinkRover
from drivers.mavlink_vehicle import MavlinkVehicle
from drivers.rover_dynamics import NoisyOdometry, RoverDynamics, RoverModel
from mapping.mount import Mount
from tools.car_emulation import CarInWorld
from tools.driven_world import DrivenWorld
from tools.world import World

FloatArray = NDArray[np.float64]

START_NS = 1_000_000_000
_BAUD = 921600


class SetpointTap:
    """Passes bytes on to a device and notes what setpoints left for it, whether or not it hears them.

    sent: time in s and speed in m/s of each.
    """

    def __init__(self, device: EmulatedDevice) -> None:
        self.sent: list[tuple[float, float]] = []
        self._device = device
        self._codec = MavlinkCodec(0, 0)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Take bytes from the host; return what the device answers."""
        for message in self._codec.decode(data):
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                self.sent.append((now_ns * 1e-9, float(message.vx)))
        return self._device.receive(data, now_ns)

    def due(self, now_ns: int) -> bytes:
        """Return what the device sends of its own accord."""
        return self._device.due(now_ns)


class SimulatedCar:
    """A rover at `pose` (3,) of a world, standing, from START_NS on; vehicle: our end of the link, not yet connected.

    world: a ranger for the emulated lidar. clock: moves where it is told to, and where our end waits.
    """

    def __init__(
        self, walls: World, pose: FloatArray, mount: Mount, *, seed: int, model: RoverModel | None = None
    ) -> None:
        self.clock = SimulatedClock(START_NS)
        self.rover = MavlinkRover(RoverDynamics(pose, model), odometry=NoisyOdometry(seed=seed))
        self.world = DrivenWorld(walls, self.rover, mount, start_ns=START_NS, seed=seed)
        self._tap = SetpointTap(CarInWorld(self.world, self.rover))
        self.wire = EmulatedLink(self._tap, self.clock, _BAUD, _BAUD)
        self.vehicle = MavlinkVehicle("simulated rover", lambda: self.wire, self.clock)

    @property
    def sent(self) -> list[tuple[float, float]]:
        """Time in s and speed in m/s of each setpoint that left for the rover."""
        return self._tap.sent
