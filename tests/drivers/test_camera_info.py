from __future__ import annotations

from pathlib import Path

import pytest

from drivers.camera_info import read_camera_info
from drivers.errors import RecordingError
from drivers.messages import Pinhole

CALIBRATION = """\
image_width: 640
image_height: 480
camera_name: kinect
camera_matrix:
  rows: 3
  cols: 3
  data: [585.0, 0, 320.5, 0.0, 586.0, 239.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.0, 0, 0, 0, 0]}
"""
MESSAGE = """\
header: {frame_id: camera}
height: 480
width: 640
distortion_model: plumb_bob
d: [0.1, 0.0, 0.0, 0.0, 0.0]
k: [585.0, 0.0, 320.5, 0.0, 586.0, 239.5, 0.0, 0.0, 1.0]
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "camera.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("text", "distorted"), [(CALIBRATION, False), (MESSAGE, True)])
def test_both_spellings_say_the_same(text, distorted, tmp_path):
    info = read_camera_info(write(tmp_path, text))
    assert info.camera == Pinhole(640, 480, 585.0, 586.0, 320.5, 239.5)
    assert info.distorted is distorted


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a: [1", r"not a YAML file \(line 1: [^)]*\): expected a camera_info YAML"),
        ("just words", "holds no keys"),
        (CALIBRATION.replace("image_width: 640", ""), "image_width holds None"),
        (CALIBRATION.replace("640", "-640"), "-640x480 pixels"),
        (CALIBRATION.replace("585.0", "0.0"), "focal lengths 0 and 586"),
        (CALIBRATION.replace("585.0", ".nan"), "camera_matrix holds nan"),
        (CALIBRATION.replace(", 0, 0, 1]", "]"), "camera matrix of 6 numbers"),
        (CALIBRATION.replace("[585.0, 0, 320.5, 0.0, 586.0, 239.5, 0, 0, 1]", "none"), "expected a list of numbers"),
    ],
)
def test_a_file_that_is_none_is_refused_in_one_line(text, complaint, tmp_path):
    with pytest.raises(RecordingError, match=complaint) as raised:
        read_camera_info(write(tmp_path, text))
    assert "\n" not in str(raised.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="cannot be read"):
        read_camera_info(tmp_path / "none.yaml")
