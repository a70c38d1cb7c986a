from __future__ import annotations

import math

import pytest

from drivers.emulated_faults import FAULTS, Fault, FaultError, FaultKind, FaultScript, parse_fault, parse_script


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("flip=0.002", Fault(FaultKind.FLIP, (0.002,))),
        ("silence@5+2", Fault(FaultKind.SILENCE, start_s=5.0, duration_s=2.0)),
        ("health=error:0x8001:stays@3", Fault(FaultKind.HEALTH, (2, 0x8001, 1.0), "", 3.0)),
        ("health=warning", Fault(FaultKind.HEALTH, (1, 0, 0.0))),
        ("mute=GET_LIDAR_CONF", Fault(FaultKind.MUTE, word="GET_LIDAR_CONF")),
        ("noise=0.01:0.02", Fault(FaultKind.NOISE, (0.01, 0.02))),
        ("drift=0.1", Fault(FaultKind.DRIFT, (0.1,))),
    ],
)
def test_a_fault_is_read_as_written(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    "text",
    [
        *("", "melt", "flip", "flip=x", "flip=2", "flip=0.1:0.2", "unplug", "silence@", "silence@x", "silence@-1"),
        *("stall@1+0", "mute=SING", "health=ill", "health=error:70000", "health=error:1:goes", "drift=0.1@3"),
        "silence@inf",
    ],
)
def test_what_cannot_be_read_is_one_line(text: str) -> None:
    with pytest.raises(FaultError, match="^fault .*[:,]") as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)


def test_a_script_has_comments_and_empty_lines() -> None:
    faults = parse_script("# all day\nflip=0.1  # often\n\nunplug@3+1\n")
    assert [fault.kind for fault in faults] == [FaultKind.FLIP, FaultKind.UNPLUG]


def test_every_kind_says_how_it_is_written() -> None:
    assert set(FAULTS) == set(FaultKind)
    for kind, form in FAULTS.items():
        assert form.text.startswith(kind.value)


def test_times_count_from_the_first_scan_request() -> None:
    script = FaultScript(parse_script("silence@1+2\nflip=0.5"))
    assert script.active(FaultKind.FLIP, 0) is not None
    assert script.active(FaultKind.SILENCE, 10**10) is None
    script.begin(10**10)
    script.begin(10**12)
    active = [script.active(FaultKind.SILENCE, 10**10 + at * 10**9) is not None for at in (0, 1, 2, 3)]
    assert active == [False, True, True, False]
    assert script.span_ns(script.faults[1]) == (-math.inf, math.inf)


def test_a_fault_may_be_added_while_the_script_runs() -> None:
    script = FaultScript()
    script.begin(0)
    assert script.active(FaultKind.SILENCE, 10) is None
    script.add(Fault(FaultKind.SILENCE))
    assert script.active(FaultKind.SILENCE, 10) is not None
