from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from drivers.messages import Odometry
from drivers.recording_writer import McapRecorder


@pytest.fixture
def frames(tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(2):
        image = cv2.imencode(".png", np.full((4, 5), 700 + number, np.uint16))[1]
        (folder / f"depth_{number}.png").write_bytes(image.tobytes())
    (tmp_path / "k.txt").write_text("500 0 2\n0 500 2\n0 0 1\n")
    return folder


def test_a_folder_of_depth_images_becomes_an_mcap_file_whose_depth_is_listed(frames, cli, tmp_path):
    options = ("--intrinsics", tmp_path / "k.txt", "--depth-unit", "0.0002")
    done = cli("bag", "convert", frames, "-o", tmp_path / "new.mcap", *options, "--json")
    assert done.code == 0
    assert json.loads(done.out)["topics"] == {"/camera/depth/image_rect_raw": 2}

    info = cli("bag", "info", tmp_path / "new.mcap", "--json")
    topics = {topic["name"]: topic for topic in json.loads(info.out)["topics"]}
    assert topics["/camera/depth/image_rect_raw"] == {
        "name": "/camera/depth/image_rect_raw",
        "type": "sensor_msgs/msg/Image",
        "count": 2,
        "read_here": True,
    }
    assert cli("bag", "check", tmp_path / "new.mcap").code == 0
    assert "2" in cli("bag", "info", frames, "--intrinsics", tmp_path / "k.txt").out


def test_a_damaged_input_is_converted_as_far_as_it_goes_with_exit_code_3(frames, cli, tmp_path):
    (frames / "depth_1.png").write_bytes(b"no image")
    (frames / "camera-intrinsics.txt").write_text((tmp_path / "k.txt").read_text())
    done = cli("bag", "convert", frames, "-o", tmp_path / "new.mcap")
    assert done.code == 3
    assert "damaged: 1 file cannot be read: no PNG" in done.out


def test_what_was_left_out_is_said(cli, tmp_path):
    log = tmp_path / "a.log"
    line = "LASER 3 1.0 2.0 3.0 0 0 0 0 0 0 10.5 host 0.5\n"
    log.write_text(f"F{line}R{line}")
    done = cli("bag", "convert", log, "-o", tmp_path / "new.mcap")
    assert (done.code, "left out: 1 CARMEN RLASER" in done.out) == (0, True)


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "empty"), (b"#ROSBAG V2.0\n", "ROS 1"), (b"hello, world", "not a recording"), (None, "no such file")],
)
def test_bad_input_is_one_line_and_no_file(content, says, cli, tmp_path):
    file = tmp_path / "x.mcap"
    if content is not None:
        file.write_bytes(content)
    outcome = cli("bag", "convert", file, "-o", tmp_path / "new.mcap")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert says in outcome.error_lines[0]
    assert not (tmp_path / "new.mcap").exists()


def test_depth_without_intrinsics_is_one_line_that_says_what_to_give(frames, cli, tmp_path):
    outcome = cli("bag", "convert", frames, "-o", tmp_path / "new.mcap")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "--intrinsics" in outcome.error_lines[0]


def test_an_existing_file_is_kept(frames, cli, tmp_path):
    (tmp_path / "kept.mcap").write_text("years of work")
    outcome = cli("bag", "convert", frames, "-o", tmp_path / "kept.mcap", "--intrinsics", tmp_path / "k.txt")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert (tmp_path / "kept.mcap").read_text() == "years of work"


def test_replay_of_depth_that_sees_too_little_is_refused_in_one_line(frames, cli, tmp_path):
    options = ("--intrinsics", tmp_path / "k.txt")
    assert cli("bag", "convert", frames, "-o", tmp_path / "new.mcap", *options).code == 0
    outcome = cli("replay", tmp_path / "new.mcap", "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "none of its 2 images can be mapped" in outcome.error_lines[0]


def test_a_cut_image_is_damage_to_info_and_check_too(frames, cli, tmp_path):
    (frames / "camera-intrinsics.txt").write_text((tmp_path / "k.txt").read_text())
    assert cli("bag", "info", frames).code == 0
    assert cli("bag", "check", frames).code == 0
    whole = (frames / "depth_1.png").read_bytes()
    (frames / "depth_1.png").write_bytes(whole[: len(whole) // 2])
    info, check = cli("bag", "info", frames), cli("bag", "check", frames)
    assert (info.code, check.code) == (3, 3)
    assert "damaged: 1 file" in info.out
    assert "`bag convert` saves" in check.out


def test_check_takes_the_intrinsics_that_a_folder_lacks(frames, cli, tmp_path):
    assert "--intrinsics" in cli("bag", "check", frames).error_lines[0]
    assert cli("bag", "check", frames, "--intrinsics", tmp_path / "k.txt").code == 0


def test_recover_says_what_else_there_is(frames, cli, tmp_path):
    log = tmp_path / "a.log"
    log.write_text("FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 10.5 host 0.5\n")
    for source in (frames, log):
        outcome = cli("bag", "recover", source, tmp_path / "new.mcap")
        assert (outcome.code, len(outcome.error_lines)) == (1, 1)
        assert "bag convert" in outcome.error_lines[0]


@pytest.mark.parametrize(("command", "option"), [("replay", "--depth-unit"), ("bag", "--intrinsics")])
def test_options_of_depth_folders_are_refused_elsewhere(command, option, cli, tmp_path):
    log = tmp_path / "a.log"
    log.write_text("FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 10.5 host 0.5\n")
    words = ("replay", log) if command == "replay" else ("bag", "info", log)
    outcome = cli(*words, option, "0.001" if option == "--depth-unit" else log)
    assert (outcome.code, len(outcome.error_lines)) == (2, 1)
    assert option in outcome.error_lines[0]


def test_many_topics_are_counted_not_listed(cli, tmp_path):
    with McapRecorder(tmp_path / "a.mcap", metadata={}) as recorder:
        for number in range(20):
            recorder.put(Odometry(number + 1, np.zeros(3), np.zeros(3)), f"/odometry_of_robot_{number}")
    done = cli("bag", "convert", tmp_path / "a.mcap", "-o", tmp_path / "b.mcap")
    assert "20 messages on 20 topics" in done.out
