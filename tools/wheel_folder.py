"""Wheels for a computer that has no network: gathered here for its architecture, Python and C library.

pip alone does not do it: `pip download --platform` heeds the other computer in the wheels' tags, but evaluates the
markers of dependencies (python_version, platform_machine) for the Python it runs in. So each wheel is fetched without
its dependencies, and what it depends on there is read from its metadata.
"""

from __future__ import annotations

import email.parser
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name, parse_wheel_filename

from tools.errors import ToolError

_OLDEST_GLIBC = {"aarch64": 17, "x86_64": 5}  # of the manylinux tags: glibc 2.17 and 2.5
_LEGACY_TAGS = {
    "aarch64": {17: "manylinux2014"},
    "x86_64": {17: "manylinux2014", 12: "manylinux2010", 5: "manylinux1"},
}
_NOT_THERE = re.compile(r"No matching distribution found|Could not find a version")
_NO_ANSWER = re.compile(r"Retrying|connection|timed out|Temporary failure|name resolution", re.IGNORECASE)
_VERSIONS = re.compile(r"^Available versions: ([^,\s]+)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class CarComputer:
    """machine: aarch64 or x86_64; python: (3, minor) of CPython; glibc_minor: of 2.N, as `ldd --version` tells."""

    machine: str
    python: tuple[int, int]
    glibc_minor: int

    def __str__(self) -> str:
        return f"{self.machine}, Python {self.version}, glibc 2.{self.glibc_minor}"

    @property
    def version(self) -> str:
        """The version of Python in two numbers."""
        return f"{self.python[0]}.{self.python[1]}"

    def platforms(self) -> list[str]:
        """Return the platform tags whose wheels run there, the newest first (PEP 600 and those before it)."""
        tags = []
        for minor in range(self.glibc_minor, _OLDEST_GLIBC[self.machine] - 1, -1):
            tags.append(f"manylinux_2_{minor}_{self.machine}")
            if minor in _LEGACY_TAGS[self.machine]:
                tags.append(f"{_LEGACY_TAGS[self.machine][minor]}_{self.machine}")
        return [*tags, f"linux_{self.machine}"]

    def pip_options(self) -> list[str]:
        """Return the options by which pip takes wheels for that computer."""
        abi = f"cp{self.python[0]}{self.python[1]}"
        options = ["--only-binary=:all:", "--python-version", self.version, "--implementation", "cp"]
        for name in (abi, "abi3", "none"):
            options += ["--abi", name]
        for platform in self.platforms():
            options += ["--platform", platform]
        return options

    def markers(self) -> dict[str, str]:
        """Return what the markers of dependencies ask (PEP 508)."""
        return {
            "implementation_name": "cpython",
            "implementation_version": f"{self.version}.0",
            "os_name": "posix",
            "platform_machine": self.machine,
            "platform_python_implementation": "CPython",
            "platform_release": "",
            "platform_system": "Linux",
            "platform_version": "",
            "python_full_version": f"{self.version}.0",
            "python_version": self.version,
            "sys_platform": "linux",
        }

    def heeds(self, requirement: Requirement, extras: Iterable[str] = ()) -> bool:
        """Whether a requirement holds there, for a package with these extras."""
        marker = requirement.marker
        return marker is None or any(marker.evaluate({**self.markers(), "extra": extra}) for extra in (*extras, ""))


@dataclass(frozen=True, slots=True)
class WantedWheel:
    """A wheel that something needs: `name==pin`, or where that has none for the computer what `allowed` says."""

    allowed: Requirement
    pin: str | None
    needed_by: str

    @property
    def name(self) -> str:
        """The canonical name."""
        return canonicalize_name(self.allowed.name)

    @property
    def pinned(self) -> str:
        """What is asked of pip first."""
        return f"{self.name}=={self.pin}" if self.pin else self.unpinned

    @property
    def unpinned(self) -> str:
        """What is asked of pip then."""
        return f"{self.name}{self.allowed.specifier}"


@dataclass(frozen=True, slots=True)
class MissingWheel:
    """A wheel that there is none of; newest: the newest version that has one for the computer, None: no version has."""

    wanted: WantedWheel
    newest: str | None


@dataclass(frozen=True, slots=True)
class WheelFolder:
    """What was gathered: wheels by name; of these, those that are not the pinned version; and what is missing."""

    wheels: Mapping[str, Path]
    others: Sequence[WantedWheel]
    missing: Sequence[MissingWheel]


def pins(constraints: str, computer: CarComputer) -> dict[str, str]:
    """Return name -> version of the lines of a constraints file that hold on that computer."""
    found: dict[str, str] = {}
    for line in constraints.splitlines():
        text = line.partition("#")[0].strip()
        if not text:
            continue
        requirement = Requirement(text)
        (version,) = requirement.specifier
        if computer.heeds(requirement):
            found[canonicalize_name(requirement.name)] = version.version
    return found


def dependencies(wheel: Path, extras: Iterable[str], computer: CarComputer) -> Iterator[Requirement]:
    """Yield what a wheel needs on that computer, by its own metadata."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (entry for entry in archive.namelist() if re.fullmatch(r"[^/]+\.dist-info/METADATA", entry))
        metadata = email.parser.BytesParser().parsebytes(archive.read(name))
    for text in metadata.get_all("Requires-Dist", []):
        requirement = Requirement(text)
        if computer.heeds(requirement, extras):
            yield requirement


def gather(
    own: Path, extras: Sequence[str], pinned: Mapping[str, str], computer: CarComputer, folder: Path
) -> WheelFolder:
    """Fetch all that the wheel `own` needs on that computer, and what that needs, into the folder.

    Raises ToolError where pip fails for another reason than that there is no such wheel.
    """
    wheels = {_name_of(own): own}
    others: list[WantedWheel] = []
    missing: dict[str, MissingWheel] = {}
    looked: set[tuple[str, tuple[str, ...]]] = set()
    layer = [(own, tuple(extras))]
    while layer:
        wanted: dict[str, WantedWheel] = {}
        asked: dict[str, tuple[str, ...]] = {}
        for wheel, its_extras in layer:
            looked.add((_name_of(wheel), its_extras))
            for needed in dependencies(wheel, its_extras, computer):
                name = canonicalize_name(needed.name)
                asked[name] = tuple(sorted({*asked.get(name, ()), *needed.extras}))
                if name not in wheels and name not in missing:
                    wanted.setdefault(name, WantedWheel(needed, pinned.get(name), _name_of(wheel)))
        others += _fetch(list(wanted.values()), computer, folder)
        wheels.update(_wheels_in(folder))
        for absent in wanted.values():
            if absent.name not in wheels:
                missing[absent.name] = MissingWheel(absent, _newest(absent.name, computer))
        layer = [(wheels[name], more) for name, more in asked.items() if name in wheels and (name, more) not in looked]
    return WheelFolder(wheels, others, list(missing.values()))


def build_own_wheel(project: Path, folder: Path) -> Path:
    """Build the wheel of this program from its checkout; raises ToolError."""
    done = _pip(["wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(project)])
    if done.returncode != 0:
        raise ToolError(f"{project}: its wheel cannot be built: {_last_line(done.stderr)}")
    return _wheels_in(folder)["mapfuse-robot"]


def _fetch(wanted: Sequence[WantedWheel], computer: CarComputer, folder: Path) -> list[WantedWheel]:
    """Fetch what there is; return those that were not to be had as pinned, but otherwise."""
    if not wanted or _downloaded([wheel.pinned for wheel in wanted], computer, folder):
        return []
    others = []
    for wheel in wanted:  # one of them is not there: each by itself
        if _downloaded([wheel.pinned], computer, folder):
            continue
        if wheel.pin and _downloaded([wheel.unpinned], computer, folder):
            others.append(wheel)
    return others


def _downloaded(names: Sequence[str], computer: CarComputer, folder: Path) -> bool:
    """Whether pip found wheels of all these; raises ToolError where it could not look."""
    command = ["download", "--quiet", "--no-deps", *computer.pip_options(), "--dest", str(folder), *names]
    done = _pip(command)
    if done.returncode == 0:
        return True
    if _NOT_THERE.search(done.stderr) and not _NO_ANSWER.search(done.stderr):
        return False
    raise ToolError(f"pip cannot fetch {', '.join(names)}: {_last_line(done.stderr)}: is there a network?")


def _newest(name: str, computer: CarComputer) -> str | None:
    found = _VERSIONS.search(_pip(["index", "versions", name, *computer.pip_options()]).stdout)
    return found.group(1) if found else None


def _pip(arguments: Sequence[str]) -> subprocess.CompletedProcess[str]:
    # The constraints are of this computer's Python: what holds on the other one is in the arguments.
    environment = {name: value for name, value in os.environ.items() if name != "PIP_CONSTRAINT"}
    command = [sys.executable, "-m", "pip", *arguments, "--disable-pip-version-check", "--retries", "1"]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)  # noqa: S603 - pip


def _last_line(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("[notice]")]
    return lines[-1].strip() if lines else "it says nothing"


def _wheels_in(folder: Path) -> dict[str, Path]:
    return {_name_of(file): file for file in folder.glob("*.whl")}


def _name_of(wheel: Path) -> str:
    return parse_wheel_filename(wheel.name)[0]
