"""What can go wrong with an emulated lidar, as a script: which fault, how strong, from when and for how long.

A fault is written KIND[=VALUE[:VALUE]][@START[+DURATION]]: `flip=0.002`, `silence@5+2`, `health=error:0x8001@3`.
START is in seconds after the first scan request; without it the fault holds from the beginning, without DURATION to
the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from drivers.rplidar_protocol import Command


class FaultKind(str, Enum):
    """What goes wrong; FAULTS says what values each takes."""

    FLIP = "flip"
    DROP = "drop"
    CHUNK = "chunk"
    LATENCY = "latency"
    STALL = "stall"
    SILENCE = "silence"
    UNPLUG = "unplug"
    MOTOR_STALL = "motor-stall"
    HEALTH = "health"
    SLOW = "slow"
    MUTE = "mute"
    BANNER = "banner"
    REBOOT = "reboot"
    JITTER = "jitter"
    DRIFT = "drift"
    INVALID = "invalid"
    NOISE = "noise"


@dataclass(frozen=True, slots=True)
class FaultForm:
    """How a kind of fault is written: least and most of each number, and what it does, for --help and errors."""

    text: str
    limits: tuple[tuple[float, float], ...] = ()
    optional: int = 0  # so many of the numbers may be left out, from the end
    when: Literal["any", "required", "always"] = "any"  # may, must or cannot @START be given


FAULTS = {
    FaultKind.FLIP: FaultForm("flip=SHARE: so many of the bytes sent to the host have one bit wrong", ((0, 1),)),
    FaultKind.DROP: FaultForm("drop=SHARE: so many of the bytes sent to the host are lost", ((0, 1),)),
    FaultKind.CHUNK: FaultForm("chunk=BYTES: bytes arrive in pieces of at most so many", ((1, 4096),)),
    FaultKind.LATENCY: FaultForm("latency=S: a USB adapter that hands over what it has every so often", ((0, 1),)),
    FaultKind.STALL: FaultForm("stall@START+S: nothing arrives for so long, then everything", when="required"),
    FaultKind.SILENCE: FaultForm("silence[@START]: nothing that is sent arrives"),
    FaultKind.UNPLUG: FaultForm("unplug@START[+S]: the port vanishes, and comes back after S", when="required"),
    FaultKind.MOTOR_STALL: FaultForm("motor-stall[@START]: the head stands still, the sensor answers"),
    FaultKind.HEALTH: FaultForm("health=warning|error[:CODE[:stays]]: GET_HEALTH's answer; stays: also after a reset"),
    FaultKind.SLOW: FaultForm("slow=S: answers come so late", ((0, 60),)),
    FaultKind.MUTE: FaultForm("mute=COMMAND: this request is ignored, such as GET_LIDAR_CONF"),
    FaultKind.BANNER: FaultForm("banner@START: the boot text appears amid the data", when="required"),
    FaultKind.REBOOT: FaultForm(
        "reboot@START: a dip of the supply: the scan ends, the boot text comes", when="required"
    ),
    FaultKind.JITTER: FaultForm("jitter=DEG: angles scatter by this standard deviation", ((0, 5),)),
    FaultKind.DRIFT: FaultForm(
        "drift=SHARE[:S]: the speed swings by this share, once in S (20)", ((0, 0.5), (0.1, 1e4)), 1, when="always"
    ),
    FaultKind.INVALID: FaultForm("invalid=SHARE: so many of the samples measure nothing", ((0, 1),)),
    FaultKind.NOISE: FaultForm("noise=M[:SHARE]: ranges scatter by M and this share of them", ((0, 1), (0, 1)), 1),
}
_HEALTH_STATES = {"warning": 1, "error": 2}


class FaultError(ValueError):
    """A fault that cannot be read; the text is one line for the user."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault. numbers: its values; word: the command that MUTE names. start_s None: from the beginning.

    HEALTH has the numbers status, error code, and 1 if it outlives a reset.
    """

    kind: FaultKind
    numbers: tuple[float, ...] = ()
    word: str = ""
    start_s: float | None = None
    duration_s: float = math.inf

    def number(self, place: int, default: float) -> float:
        """A value, or the default where it was left out."""
        return self.numbers[place] if place < len(self.numbers) else default


def parse_fault(text: str) -> Fault:
    """Read one fault as the module describes it; FaultError says what was expected."""
    what, _, when = text.strip().partition("@")
    name, _, value = what.partition("=")
    if name not in {kind.value for kind in FaultKind}:
        raise FaultError(f"fault {text!r}: unknown, choose one of {', '.join(kind.value for kind in FaultKind)}")
    kind = FaultKind(name)
    form = FAULTS[kind]
    start_s, duration_s = _parse_when(text, when, form)
    if kind == FaultKind.MUTE:
        if value not in Command.__members__:
            raise FaultError(f"fault {text!r}: {value!r} is no request, choose one of {', '.join(Command.__members__)}")
        return Fault(kind, word=value, start_s=start_s, duration_s=duration_s)
    numbers = _parse_health(text, value) if kind == FaultKind.HEALTH else _parse_numbers(text, value, form)
    return Fault(kind, numbers, "", start_s, duration_s)


def parse_script(text: str) -> tuple[Fault, ...]:
    """Read one fault a line; # begins a comment."""
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    return tuple(parse_fault(line) for line in lines if line)


class FaultScript:
    """The faults of one emulated lidar on its time, which begins with the first scan request.

    seed: of all that is random in them.
    """

    def __init__(self, faults: Iterable[Fault] = (), seed: int = 0) -> None:
        self.faults = tuple(faults)
        self.seed = seed
        self._began_ns: int | None = None

    def begin(self, now_ns: int) -> None:
        """The first call starts the script."""
        if self._began_ns is None:
            self._began_ns = now_ns

    def add(self, fault: Fault) -> None:
        """Let another fault be; one without a start holds from now on."""
        self.faults = (*self.faults, fault)

    def span_ns(self, fault: Fault) -> tuple[float, float]:
        """From when to when the fault holds, in ns of the callers' clock; infinite before the script has begun."""
        if fault.start_s is None:
            return -math.inf, math.inf
        if self._began_ns is None:
            return math.inf, math.inf
        start_ns = self._began_ns + fault.start_s * 1e9
        return start_ns, start_ns + fault.duration_s * 1e9

    def active(self, kind: FaultKind, now_ns: int, word: str = "") -> Fault | None:
        """The first fault of this kind (and for this request) that holds now."""
        for fault in self.faults:
            if fault.kind == kind and fault.word == word:
                start_ns, end_ns = self.span_ns(fault)
                if start_ns <= now_ns < end_ns:
                    return fault
        return None

    def of_kind(self, *kinds: FaultKind) -> tuple[Fault, ...]:
        """All faults of these kinds, in the order of the script."""
        return tuple(fault for fault in self.faults if fault.kind in kinds)


def _parse_when(text: str, when: str, form: FaultForm) -> tuple[float | None, float]:
    if not when:
        if form.when == "required" or "@" in text:
            raise FaultError(f"fault {text!r}: say when, in seconds after the first scan request: {form.text}")
        return None, math.inf
    if form.when == "always":
        raise FaultError(f"fault {text!r}: holds from the beginning to the end, leave out @START: {form.text}")
    start, plus, duration = when.partition("+")
    try:
        span = float(start), float(duration) if plus else math.inf
    except ValueError as error:
        raise FaultError(f"fault {text!r}: expected @START or @START+DURATION in seconds") from error
    if not (span[0] >= 0 and span[1] > 0 and math.isfinite(span[0])):
        raise FaultError(f"fault {text!r}: expected a START of 0 or more and a DURATION above 0, in seconds")
    return span


def _parse_numbers(text: str, value: str, form: FaultForm) -> tuple[float, ...]:
    parts = value.split(":") if value else []
    most = len(form.limits)
    try:
        numbers = tuple(float(part) for part in parts)
    except ValueError as error:
        raise FaultError(f"fault {text!r}: expected numbers: {form.text}") from error
    if not most - form.optional <= len(numbers) <= most:
        raise FaultError(f"fault {text!r}: {len(numbers)} values: {form.text}")
    for number, (low, high) in zip(numbers, form.limits, strict=False):
        if not low <= number <= high:
            raise FaultError(f"fault {text!r}: {number:g} is not within {low:g} and {high:g}: {form.text}")
    return numbers


def _parse_health(text: str, value: str) -> tuple[float, ...]:
    state, _, rest = value.partition(":")
    code, _, stays = rest.partition(":")
    try:
        number = int(code, 0) if code else 0
    except ValueError:
        number = -1
    if state not in _HEALTH_STATES or not 0 <= number <= 0xFFFF or stays not in {"", "stays"}:
        raise FaultError(f"fault {text!r}: {FAULTS[FaultKind.HEALTH].text}; CODE is 0 to 0xFFFF")
    return _HEALTH_STATES[state], number, float(stays == "stays")
