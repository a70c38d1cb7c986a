"""The text of a systemd unit that runs a command of this program on a car (systemd.service(5), systemd.syntax(7))."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_PLAIN = re.compile(r"[\w@:,./=+-]+")


@dataclass(frozen=True, slots=True)
class ServiceUnit:
    """program: the command and its arguments, the first an absolute path; folder: where it runs, absolute.

    start_s, stop_s: how long it may take until the first scan is mapped, and to save at the end. watchdog_s: it is
    ended when mapping stands still for so long. restarts: it is started again where it fails; a car that drives is not.
    own_guard: a process of it must outlive it for a moment, as the one that stops a QCar's motor.
    """

    program: Sequence[str]
    folder: Path
    user: str
    restarts: bool = True
    own_guard: bool = False
    start_s: int = 300
    stop_s: int = 180
    watchdog_s: int = 20

    def text(self) -> str:
        """Return the file's contents."""
        # mixed: the signal to stop goes to the program alone, and what is left after it is killed.
        kill = ["KillMode=process" if self.own_guard else "KillMode=mixed", "KillSignal=SIGINT"]
        again = ["Restart=on-failure", "RestartSec=5"] if self.restarts else ["Restart=no"]
        lines = [
            "[Unit]",
            "Description=mapfuse-robot: maps with the sensors of this car",
            "StartLimitIntervalSec=0",
            "",
            "[Service]",
            "Type=notify",
            f"ExecStart={' '.join(quoted(word) for word in self.program)}",
            f"WorkingDirectory={_unspecified(str(self.folder))}",
            f"User={self.user}",
            "SupplementaryGroups=dialout video",
            f"TimeoutStartSec={self.start_s}",
            f"TimeoutStopSec={self.stop_s}",
            f"WatchdogSec={self.watchdog_s}",
            *kill,
            # 3: it is done, but not all of it, as where scans were dropped. To start again would not mend that.
            "SuccessExitStatus=3",
            *again,
            "",
            "[Install]",
            "WantedBy=multi-user.target",
        ]
        return "\n".join(lines) + "\n"


def quoted(word: str) -> str:
    """Return a word of a command line as ExecStart wants it: no specifier, no variable, no escape in it."""
    plain = _unspecified(word).replace("$", "$$")
    if _PLAIN.fullmatch(plain):
        return plain
    escaped = plain.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _unspecified(text: str) -> str:
    return text.replace("%", "%%")
