"""The default registration on public maps of other buildings."""

from __future__ import annotations

import pytest

from fusion.layered import register_layers
from mapping.map_io import read_map

pytestmark = pytest.mark.real_data


def test_two_buildings_are_refused_and_not_called_ambiguous(data_dir):
    """27 m of wall agree and another place has 31 m: large open maps agree anywhere, and no place is likely."""
    maps = data_dir / "maps_planning"
    found = register_layers(read_map(maps / "depot.yaml"), read_map(maps / "intel-lab.yaml"))
    assert not found.accepted
    assert not found.ambiguous
    assert "not sure enough" in found.reason
    assert found.probability is not None
    assert found.probability < 0.05
