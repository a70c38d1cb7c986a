"""The installed project is this checkout, and what is committed is free of addresses and of one machine's paths."""

from __future__ import annotations

import importlib
import re
import subprocess
from importlib import metadata
from pathlib import Path

import pytest

PACKAGES = ("drivers", "mapping", "fusion", "planning", "tools")
LOCK_FILES = {"uv.lock", "poetry.lock", "pdm.lock", "pylock.toml", "Pipfile.lock", "package-lock.json", "yarn.lock"}
PIN = re.compile(r'(?P<name>[a-z0-9-]+)==(?P<version>[0-9][0-9a-z.]*)(?P<marker> ; python_version (<|>=) "3\.\d+")?')
# The folder of a person, of root, of a build or of a temporary file, where a path of our own would be relative.
MACHINE_PATH = re.compile(r"(?:^|[^\w.~-])/(?:root|home|Users|work|farm|tmp)/[\w.-]")
INDEX_OPTION = re.compile(r"-{2}(?:extra-)?index-url|(?:extra-)?index-url\s*=|-{2}find-links\b")


@pytest.fixture(scope="module")
def texts_in_version_control(project_root: Path) -> dict[str, str]:
    """Every text file that git has or would take, by its path; binary files are left out."""
    if not (project_root / ".git").exists():
        pytest.skip("not a git checkout: there is no list of committed files")
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(command, cwd=project_root, capture_output=True, check=True).stdout
    texts = {}
    for name in filter(None, listing.decode().split("\0")):
        path = project_root / name
        content = path.read_bytes() if path.is_file() else b"\0"
        if b"\0" not in content:
            texts[name] = content.decode("utf-8", errors="replace")
    return texts


def offending_lines(texts: dict[str, str], pattern: re.Pattern[str]) -> list[str]:
    return [
        f"{name}:{number}: {line.strip()[:120]}"
        for name, text in texts.items()
        for number, line in enumerate(text.splitlines(), start=1)
        if pattern.search(line)
    ]


def pins(project_root: Path) -> list[str]:
    lines = (project_root / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


@pytest.mark.parametrize("name", PACKAGES)
def test_package_is_the_one_of_this_checkout(name: str, project_root: Path) -> None:
    location = importlib.import_module(name).__file__
    assert location is not None, f"{name} is a namespace package: {name}/__init__.py is missing"
    assert Path(location).resolve() == project_root / name / "__init__.py", "a foreign package shadows ours"


def test_wheel_takes_exactly_the_five_packages(project_root: Path) -> None:
    text = (project_root / "pyproject.toml").read_text(encoding="utf-8")
    listed = re.search(r"^\[tool\.hatch\.build\.targets\.wheel\]\npackages = \[(.*)\]$", text, re.MULTILINE)
    assert listed is not None
    assert tuple(re.findall(r'"(\w+)"', listed[1])) == PACKAGES


def test_console_script_resolves_to_a_function_of_the_checkout() -> None:
    scripts = [
        entry
        for entry in metadata.distribution("mapfuse-robot").entry_points
        if entry.group == "console_scripts" and entry.name == "mapfuse-robot"
    ]
    assert [entry.value for entry in scripts] == ["tools.cli:main"]
    assert callable(scripts[0].load())


def test_version_is_the_same_everywhere(project_root: Path) -> None:
    declared = re.search(
        r'^version = "(.+)"$', (project_root / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE
    )
    newest = re.search(r"^## (\S+)", (project_root / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert declared is not None
    assert newest is not None
    assert metadata.version("mapfuse-robot") == declared[1] == newest[1]


def test_constraints_are_plain_pins(project_root: Path) -> None:
    wrong = [line for line in pins(project_root) if not PIN.fullmatch(line)]
    assert not wrong, f"expected name==version with at most a python_version marker, no address and no hash: {wrong}"


def test_constraints_cover_every_declared_dependency(project_root: Path) -> None:
    pinned = {match["name"] for line in pins(project_root) if (match := PIN.fullmatch(line))}
    required = metadata.requires("mapfuse-robot") or []
    names = {re.sub(r"[-_.]+", "-", re.split(r"[^\w.-]", text, maxsplit=1)[0]).lower() for text in required}
    assert len(names) > 10
    assert names - {"mapfuse-robot"} <= pinned


def test_constraints_pin_each_name_once_per_python(project_root: Path) -> None:
    markers: dict[str, list[str]] = {}
    for line in pins(project_root):
        match = PIN.fullmatch(line)
        assert match is not None, line
        markers.setdefault(match["name"], []).append(match["marker"] or "everywhere")
    old_and_new = [' ; python_version < "3.11"', ' ; python_version >= "3.11"']
    assert not {name: found for name, found in markers.items() if len(found) > 1 and sorted(found) != old_and_new}


def test_no_lock_file_is_committed(texts_in_version_control: dict[str, str]) -> None:
    assert not [name for name in texts_in_version_control if Path(name).name in LOCK_FILES]


def test_no_package_index_is_named(texts_in_version_control: dict[str, str]) -> None:
    assert not offending_lines(texts_in_version_control, INDEX_OPTION)


def test_no_path_of_one_machine_is_committed(texts_in_version_control: dict[str, str]) -> None:
    assert not offending_lines(texts_in_version_control, MACHINE_PATH)
