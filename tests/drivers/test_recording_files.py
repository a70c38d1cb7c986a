from __future__ import annotations

import contextlib

import pytest
from mcap.writer import Writer

from drivers.errors import RecordingError
from drivers.recording_files import open_storages

S = 1_000_000_000


def write_mcap(path, times=(1,)):
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/text", "cdr", schema)
        for time_ns in times:
            writer.add_message(channel, time_ns, b"", time_ns)
        writer.finish()


def opened(path):
    """Names of the files that are opened, and what is missing."""
    with contextlib.ExitStack() as stack:
        storages, problems = open_storages(path)
        for storage in storages:
            stack.callback(storage.close)
        return [storage.path.name for storage in storages], problems


def metadata(*names):
    files = "".join(f"    - {name}\n" for name in names)
    return f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n{files}"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "empty recording"),
        (b"#ROSBAG V2.0\n....", "a ROS 1 bag; convert it to ROS 2 with rosbags-convert"),
        (b"\x28\xb5\x2f\xfd....", "compressed"),
        (b"\x89MCA", "cut inside its first 4 bytes"),
        (b"SQLite form", "cut inside its first 11 bytes"),
        (b"P5 640 480", r"not a recording: it starts with b'P5 640 4'; accepted: MCAP"),
    ],
)
def test_a_file_that_is_no_recording_is_told_by_its_first_bytes(tmp_path, content, text):
    (tmp_path / "a.mcap").write_bytes(content)

    with pytest.raises(RecordingError, match=text) as caught:
        open_storages(tmp_path / "a.mcap")

    assert "a.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RecordingError, match="nothing: no such file or folder"):
        open_storages(tmp_path / "nothing")


def test_the_suffix_of_a_single_file_does_not_matter(tmp_path):
    write_mcap(tmp_path / "a.bag")

    assert opened(tmp_path / "a.bag") == (["a.bag"], [])


@pytest.mark.parametrize(("name", "text"), [("notes.txt", "no recording in this folder"), ("a.bag", "only ROS 1 bags")])
def test_a_folder_without_recordings_is_refused(tmp_path, name, text):
    (tmp_path / name).write_bytes(b"#ROSBAG V2.0\n")

    with pytest.raises(RecordingError, match=text):
        open_storages(tmp_path)


def test_the_parts_of_a_split_bag_come_in_order(tmp_path):
    for part in range(12):
        write_mcap(tmp_path / f"run_{part}.mcap", [part * S])

    assert opened(tmp_path) == ([f"run_{part}.mcap" for part in range(12)], [])


def test_metadata_names_the_parts_whatever_else_lies_there(tmp_path):
    for name in ("run_0.mcap", "run_1.mcap", "other.mcap"):
        write_mcap(tmp_path / name)
    (tmp_path / "metadata.yaml").write_text(metadata("run/run_0.mcap", "run_1.mcap", "run_2.mcap"))

    names, problems = opened(tmp_path)

    assert names == ["run_0.mcap", "run_1.mcap"]
    assert len(problems) == 1
    assert problems[0].endswith("run_2.mcap: named in metadata.yaml, but missing")


@pytest.mark.parametrize("text", ["", "[", "rosbag2_bagfile_information: 3", metadata("elsewhere_0.mcap"), "\0"])
def test_metadata_of_something_else_is_ignored(tmp_path, text):
    write_mcap(tmp_path / "run_0.mcap")
    (tmp_path / "metadata.yaml").write_text(text)

    assert opened(tmp_path) == (["run_0.mcap"], [])


@pytest.mark.parametrize("names", [("a_0.mcap", "b_0.mcap"), ("a_0.mcap", "a_0.db3")])
def test_a_folder_of_several_recordings_is_refused(tmp_path, names):
    for name in names:
        write_mcap(tmp_path / name)

    with pytest.raises(RecordingError, match="2 different recordings"):
        open_storages(tmp_path)


def test_parts_that_cover_the_same_time_are_two_recordings(tmp_path):
    write_mcap(tmp_path / "car_1.mcap", [0, 60 * S])
    write_mcap(tmp_path / "car_2.mcap", [20 * S, 80 * S])

    with pytest.raises(RecordingError, match=r"car_1\.mcap and car_2\.mcap cover the same time"):
        open_storages(tmp_path)


def test_an_empty_last_part_is_a_loss_and_no_refusal(tmp_path):
    write_mcap(tmp_path / "run_0.mcap")
    (tmp_path / "run_1.mcap").write_bytes(b"")

    names, problems = opened(tmp_path)

    assert names == ["run_0.mcap"]
    assert "run_1.mcap: empty recording" in problems[0]


def test_a_folder_of_unreadable_parts_is_refused(tmp_path):
    (tmp_path / "run_0.mcap").write_bytes(b"")

    with pytest.raises(RecordingError, match=r"run_0\.mcap: empty recording"):
        open_storages(tmp_path)
