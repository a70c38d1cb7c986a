"""Replays of the shipped recordings (simulated)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from drivers.recording_reader import open_recording
from tools.replay_run import recorded_config, replay_recording

Replay = Callable[..., tuple[Path, dict[str, object]]]


@pytest.fixture(scope="session")
def replay(project_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Replay:
    """replay(name, **options): the folder of the results, and the report."""

    def run(name, **options):
        folder = tmp_path_factory.mktemp(name)
        with open_recording(project_root / f"recordings/{name}.mcap") as recording:
            config = recorded_config(recording)
            report = replay_recording(recording, config, folder, on_progress=lambda _: None, **options)
        return folder, report

    return run


@pytest.fixture(scope="session")
def replayed_once(replay: Replay) -> Replay:
    """replayed_once(name): the same with a saved state, shared by all that only read it."""
    return cache(lambda name: replay(name, save_state=True))
