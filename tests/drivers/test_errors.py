from __future__ import annotations

import pytest
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from drivers.errors import yaml_fault


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", "line 3: "),
        ("a: 1\na: 2\n", "line 2: found duplicate key"),
        ("a:\n\tb: 1\n", "line 2: found character"),
    ],
)
def test_a_yaml_fault_is_one_short_line_with_its_place(text, says):
    with pytest.raises(YAMLError) as raised:
        YAML(typ="safe", pure=True).load(text)
    fault = yaml_fault(raised.value)
    assert fault.startswith(says)
    assert "\n" not in fault
    assert len(fault) < 120


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (UnicodeDecodeError("utf-8", b"\xff" * 5000, 0, 1, "bad"), "it is no text"),
        (ValueError("month must\n  be in 1..12"), "month must be in 1..12"),
    ],
)
def test_a_fault_without_a_place_is_told_in_its_words(error, says):
    assert yaml_fault(error) == says
