"""Faults as text."""

import math

import pytest

from drivers.mavlink_constants import RoverMode
from drivers.rover_faults import FAULTS, RoverFault, RoverFaultError, RoverFaultKind, any_holds, parse_rover_fault


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("refuse-arm", RoverFault(RoverFaultKind.REFUSE_ARM)),
        ("silence@5+2", RoverFault(RoverFaultKind.SILENCE, 5.0, 2.0)),
        ("cut@0.5", RoverFault(RoverFaultKind.CUT, 0.5, math.inf)),
        ("mode=MANUAL@8", RoverFault(RoverFaultKind.MODE, 8.0, math.inf, RoverMode.MANUAL)),
    ],
)
def test_reads(text: str, fault: RoverFault) -> None:
    assert parse_rover_fault(text) == fault


@pytest.mark.parametrize(
    "text", ["", "fire", "mode", "mode=FLY@1", "mode=MANUAL", "disarm", "cut=3", "cut@x", "cut@-1", "cut@1+0"]
)
def test_refuses(text: str) -> None:
    with pytest.raises(RoverFaultError, match="fault"):
        parse_rover_fault(text)


def test_holds_from_its_start_for_its_duration() -> None:
    faults = [parse_rover_fault("silence@5+2")]
    assert [any_holds(faults, t, RoverFaultKind.SILENCE) for t in (4.9, 5.0, 6.9, 7.0)] == [False, True, True, False]
    assert not any_holds(faults, 6.0, RoverFaultKind.DEAF)


def test_every_kind_is_explained() -> None:
    assert set(FAULTS) == set(RoverFaultKind)
