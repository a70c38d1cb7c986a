"""Each safety net that is off is told once."""

import pytest

from drivers.mavlink_checklist import checklist
from drivers.rover_autopilot import PARAMETERS

GOOD = {
    "FS_GCS_ENABLE": 1.0,
    "FS_ACTION": 2.0,
    "FS_CRASH_CHECK": 1.0,
    "FENCE_ENABLE": 1.0,
    "SYSID_MYGCS": 255.0,
    "ARMING_CHECK": 1.0,
    "GUID_TIMEOUT": 3.0,
    "VISO_TYPE": 1.0,
    "EK3_SRC1_YAW": 6.0,
    "PRX1_TYPE": 2.0,
}


def test_nothing_to_say_about_a_vehicle_that_is_set_up_or_tells_nothing() -> None:
    assert checklist(GOOD, 255) == ()
    assert checklist({}, 255) == ()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("FS_GCS_ENABLE", 0.0),
        ("FS_ACTION", 0.0),
        ("FS_CRASH_CHECK", 0.0),
        ("FENCE_ENABLE", 0.0),
        ("SYSID_MYGCS", 1.0),
        ("ARMING_CHECK", 0.0),
        ("GUID_TIMEOUT", 10.0),
        ("GUID_TIMEOUT", 0.0),
        ("VISO_TYPE", 0.0),
        ("EK3_SRC1_YAW", 1.0),
        ("PRX1_TYPE", 0.0),
    ],
)
def test_one_net_off_is_one_line_that_names_it(name: str, value: float) -> None:
    (line,) = checklist({**GOOD, name: value}, 255)
    assert name in line


def test_a_rover_as_delivered_lacks_three() -> None:
    assert len(checklist(PARAMETERS, 255)) == 3
