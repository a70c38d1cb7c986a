"""Files of planning problems."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tools.errors import ToolError
from tools.plan_problems import map_beside, read_problems

GOOD = {"start": [1.0, 2.0, 0.5], "goal": [4.0, 2.0, 0.0], "ref": 3.1}


def test_problems_are_read_with_the_map_beside_the_file(tmp_path):
    file = tmp_path / "problems.json"
    file.write_text(json.dumps({"room": [GOOD]}))
    (problem,) = read_problems(file)["room"]
    np.testing.assert_array_equal([*problem.start, *problem.goal, problem.ref_m], [1.0, 2.0, 0.5, 4.0, 2.0, 0.0, 3.1])
    assert map_beside(file, "room") == tmp_path / "room.yaml"


@pytest.mark.parametrize(
    "content",
    [
        "[]",
        "{}",
        "no json",
        '{"room": []}',
        json.dumps({"room": [GOOD | {"start": [1.0, 2.0]}]}),
        json.dumps({"room": [GOOD | {"ref": "far"}]}),
        json.dumps({"room": [{"start": GOOD["start"]}]}),
        json.dumps({"room": [GOOD | {"goal": [1.0, float("nan"), 0.0]}]}),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, content):
    file = tmp_path / "problems.json"
    file.write_text(content)
    with pytest.raises(ToolError, match=r"problems.json: not a file of planning problems \(.*\): expected") as refused:
        read_problems(file)
    assert "\n" not in str(refused.value)
