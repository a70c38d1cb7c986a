"""What all tests share: where the project and the real recordings are, and how long hypothesis searches."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

PROJECT_ROOT = Path(__file__).resolve().parent.parent

# No deadline and no speed check: a shared host may stall for a moment, and that is no fault of the code.
settings.register_profile("local", deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("ci", settings.get_profile("local"), derandomize=True, database=None)
settings.load_profile("ci" if os.environ.get("CI") else "local")


@pytest.fixture(scope="session")
def project_root() -> Path:
    """The folder with pyproject.toml."""
    return PROJECT_ROOT


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings: MAPFUSE_DATA (relative to the project) or ../shared/data; skips where absent."""
    folder = (PROJECT_ROOT / (os.environ.get("MAPFUSE_DATA") or "../shared/data")).resolve()
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}: set MAPFUSE_DATA to their folder")
    return folder


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Refuse a test that reads real data without saying so: `-m "not real_data"` would not leave it out."""
    for item in items:
        if "data_dir" in getattr(item, "fixturenames", ()) and item.get_closest_marker("real_data") is None:
            raise pytest.UsageError(f"{item.nodeid} uses data_dir: mark it with @pytest.mark.real_data")
