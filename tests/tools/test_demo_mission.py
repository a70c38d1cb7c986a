from __future__ import annotations

import json

import cv2
import pytest

from tools.demo_mission import run_demo
from tools.errors import ToolError


def test_demo_maps_the_office_and_replays_it_identically(spawn, tmp_path):
    folder = tmp_path / "demo"
    demo = spawn("demo", "-o", folder)
    _, err = demo.process.communicate(timeout=300)
    assert demo.process.returncode == 0, err
    result = json.loads((folder / "demo.json").read_text())
    assert result["identical"] is True
    assert result["decoded"] == pytest.approx(result["emitted"], rel=0.01)
    assert result["rms_m"] < 0.05
    assert cv2.imread(str(folder / "demo.png")).shape[0] > 500
    assert "Simulated data" in err


def test_demo_does_not_empty_a_folder_that_is_not_its_own(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(ToolError, match="not empty"):
        run_demo(tmp_path, "A2M8", 0)
    assert (tmp_path / "thesis.txt").exists()
