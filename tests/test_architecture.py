"""The layers hold: contracts of pyproject.toml, one importing file per adapter, a core without clock or chance."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGES = ("drivers", "mapping", "fusion", "planning", "tools")

# Third-party package -> the modules that may import it: a device, a format or an engine is adapted in one place.
ADAPTERS = {
    "kiss_icp": {
        "mapping.odometry",
        "mapping.cloud_odometry",  # in space, where the other is planar
        "tools.slam_peers",  # the peer is its own pipeline, run beside for comparison
    },
    "matplotlib": {"tools.plots"},
    "mcap": {"drivers.recording_mcap"},
    "ompl": {"planning.ompl_planners", "tools.plan_peer"},
    "open3d": {"mapping.open3d_projection"},
    "pymavlink": {"drivers.mavlink_codec"},
    "rosbags": {
        "drivers.depth_codec",
        "drivers.realsense_bag",
        "drivers.ros1_translation",
        "drivers.ros_codec",
        "drivers.ros_store",
    },
    "scipy": {"mapping.layer_correlation", "mapping.pose_graph", "tools.pair_overlap"},  # FFT, sparse solver, k-d tree
    "serial": {"drivers.serial_link"},
    "sklearn": {"tools.ranking_learning"},
}
# Each costs a good part of a second: the command that needs one imports it, so that --help answers at once.
SLOW_TO_IMPORT = (
    "cv2",
    "kiss_icp",
    "matplotlib",
    "numba",
    "ompl",
    "open3d",
    "pymavlink",
    "rosbags",
    "scipy",
    "sklearn",
)
CLOCKS_AND_CHANCE = {"datetime", "random", "secrets", "time", "uuid"}
NAMES_WITHOUT_CONTENT = {"base", "common", "helper", "helpers", "manager", "misc", "shared", "types", "util", "utils"}


def module_paths(project_root: Path, *packages: str) -> dict[str, Path]:
    """Module name -> file, of all modules of the packages."""
    return {
        ".".join(path.relative_to(project_root).with_suffix("").parts).removesuffix(".__init__"): path
        for package in packages
        for path in sorted((project_root / package).rglob("*.py"))
    }


def imported_packages(source: str) -> Iterator[str]:
    """Yield the top-level name of each absolute import, wherever in the file it stands."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module.partition(".")[0]


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Return what a file imports; each is parsed once for all tests."""
    return frozenset(imported_packages(path.read_text(encoding="utf-8")))


def importers_of(project_root: Path, package: str) -> set[str]:
    return {module for module, path in module_paths(project_root, *PACKAGES).items() if package in imports_of(path)}


def test_imports_are_found_wherever_they_stand() -> None:
    source = "import a.b, c\ndef f():\n    from d.e import g\n    from . import h\n"
    assert sorted(imported_packages(source)) == ["a", "c", "d"]


def test_layer_contracts_hold(project_root: Path) -> None:
    # In a process of its own: import-linter switches off the loggers of whoever calls it.
    program = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=project_root, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("package", sorted(ADAPTERS))
def test_third_party_package_is_imported_by_its_adapter_only(package: str, project_root: Path) -> None:
    assert importers_of(project_root, package) <= ADAPTERS[package]


def test_core_packages_ask_no_clock_and_no_chance(project_root: Path) -> None:
    offenders = {
        module: found
        for module, path in module_paths(project_root, "mapping", "fusion", "planning").items()
        if (found := CLOCKS_AND_CHANCE.intersection(imports_of(path)))
    }
    assert not offenders, "a replay must be a function of its file: take stamps and seeds as arguments"


def test_every_file_is_named_after_what_is_in_it(project_root: Path) -> None:
    modules = module_paths(project_root, *PACKAGES)
    assert not [module for module in modules if NAMES_WITHOUT_CONTENT.intersection(module.split(".")[-1].split("_"))]


def test_tests_have_no_package_files(project_root: Path) -> None:
    assert not list((project_root / "tests").rglob("__init__.py"))


def test_command_line_starts_without_the_slow_packages() -> None:
    program = f"import sys, tools.cli; print([name for name in {SLOW_TO_IMPORT!r} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout.strip()) == (0, "[]"), result.stderr
