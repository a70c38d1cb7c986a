from __future__ import annotations

import numpy as np
import pytest

from mapping.errors import MapFileError, MappingError
from mapping.mount import Mount
from mapping.slam import Mapper, MappingSettings
from mapping.slam_state import STATE_NAME, read_state, write_state


def mapped(scans) -> Mapper:
    mapper = Mapper(MappingSettings(), Mount())
    for scan in scans:
        mapper.add_scan(scan)
    mapper.finish()
    return mapper


@pytest.fixture(scope="module")
def mapper(winding) -> Mapper:
    return mapped(winding.scans[:60])


def test_a_state_comes_back_from_its_file_as_it_was(mapper, tmp_path) -> None:
    write_state(tmp_path / STATE_NAME, mapper.graph.state())
    other = Mapper(MappingSettings(), Mount())
    other.resume(read_state(tmp_path))
    for name, values in mapper.graph.state().arrays.items():
        np.testing.assert_array_equal(other.graph.state().arrays[name], values, err_msg=name)
    np.testing.assert_array_equal(other.trajectory.poses, mapper.trajectory.poses)
    np.testing.assert_array_equal(other.grid().log_odds, mapper.grid().log_odds)


def test_a_drive_from_the_same_room_is_tied_to_the_state(mapper, winding, tmp_path) -> None:
    write_state(tmp_path / STATE_NAME, mapper.graph.state())
    other = Mapper(MappingSettings(), Mount())
    other.resume(read_state(tmp_path / STATE_NAME))
    for scan in winding.scans[60:]:
        other.add_scan(scan)
    other.finish()
    pieces = other.graph.segments()
    assert [piece.scans for piece in pieces] == [60, len(winding.scans) - 60]
    truth = winding.truth.at(other.trajectory.stamps_ns)
    if all(piece.in_map for piece in pieces):  # left apart is no error, tied at a wrong place is one
        off = other.trajectory.poses[-1, :2] - (other.trajectory.poses[0, :2])
        assert np.hypot(*off) == pytest.approx(np.hypot(*(truth[-1] - truth[0])[:2]), abs=0.1)


def test_a_laser_that_sits_elsewhere_is_refused(mapper) -> None:
    other = Mapper(MappingSettings(), Mount(np.array([0.3, 0.0, 0.0])))
    with pytest.raises(MappingError, match=r"0\.30 m"):
        other.resume(mapper.graph.state())


@pytest.mark.parametrize("damage", ["missing", "cut", "other", "format", "incomplete"])
def test_a_file_that_is_no_state_is_refused_in_one_line(damage, mapper, tmp_path) -> None:
    file = tmp_path / STATE_NAME
    state = mapper.graph.state()
    write_state(file, state)
    if damage == "missing":
        file.unlink()
    elif damage == "cut":
        file.write_bytes(file.read_bytes()[:1000])
    elif damage == "other":
        file.write_bytes(b"not a state")
    elif damage == "format":
        np.savez(file, format=np.array(99), **state.arrays)
    else:
        np.savez(file, format=np.array(2), poses=state.arrays["poses"])
    with pytest.raises(MapFileError) as refused:
        read_state(tmp_path)
    assert STATE_NAME in str(refused.value)
    assert "\n" not in str(refused.value)
