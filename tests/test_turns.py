"""Among several processes, a live test runs alone, unless a core is enough for it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

# Each test writes when it begins and ends; the live ones are between the others and in two files.
SUITE = """
import os, time
from pathlib import Path
import pytest

def note(what):
    with Path(os.environ["NOTES"]).open("a") as notes:
        notes.write(f"{time.monotonic_ns()} {what}\\n")

@pytest.mark.parametrize("number", range(6))
def test_shared(number):
    note("begin shared")
    time.sleep(0.05)
    note("end shared")

@pytest.mark.live
@pytest.mark.parametrize("number", range(3))
def test_live(number):
    note("begin live")
    time.sleep(0.05)
    note("end live")

@pytest.mark.live(cores=1)
def test_with_a_core_of_its_own():
    note("begin shared")
    time.sleep(0.05)
    note("end shared")
"""


def test_nothing_runs_beside_a_live_test(tmp_path, project_root):
    shutil.copy(project_root / "tests/conftest.py", tmp_path)
    for name in ("test_a.py", "test_b.py"):
        (tmp_path / name).write_text(SUITE)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = live\n")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    ended = subprocess.run(
        [sys.executable, "-c", "import pytest; raise SystemExit(pytest.main())", "-n2", "--dist=worksteal"],
        cwd=tmp_path,
        env={**environment, "NOTES": str(tmp_path / "notes")},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "20 passed" in ended.stdout
    running: list[str] = []
    for line in sorted((tmp_path / "notes").read_text().splitlines()):
        _, what, kind = line.split()
        if what == "end":
            running.remove(kind)
        else:
            running.append(kind)
            assert running == ["live"] or "live" not in running
