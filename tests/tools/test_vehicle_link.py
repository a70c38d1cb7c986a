from __future__ import annotations

import time

import pytest

from drivers.errors import DriverError
from drivers.mavlink_vehicle import MavlinkVehicle
from drivers.qcar_vehicle import QcarVehicle
from drivers.vehicle import NullVehicle
from tools.errors import UsageError
from tools.vehicle_link import vehicle_at


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("none", NullVehicle),
        ("qcar", QcarVehicle),
        ("udp:127.0.0.1:14550", MavlinkVehicle),
        ("/dev/ttyACM0", MavlinkVehicle),
    ],
)
def test_a_vehicle_is_chosen_by_its_name_or_address(text, kind):
    assert isinstance(vehicle_at(text, time.monotonic_ns), kind)


def test_what_is_no_vehicle_is_refused_with_what_would_be():
    with pytest.raises(UsageError, match=r"--vehicle: vehicle 'nowhere': expected serial:PATH.*or qcar, or none"):
        vehicle_at("nowhere", time.monotonic_ns)


def test_a_qcars_board_is_opened_by_the_python_that_is_named():
    with (
        pytest.raises(DriverError, match="qcar: /no/such/python cannot be started"),
        vehicle_at("qcar:/no/such/python", time.monotonic_ns),
    ):
        pass
