from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drivers.depth_folder import DepthFolder, is_depth_folder
from drivers.errors import RecordingError
from drivers.messages import DepthImage, Pinhole, Transform
from drivers.recording_reader import open_recording

K = "500.5 0 2.25\n0 501.5 1.75\n0 0 1\n"
CAMERA = Pinhole(5, 4, 500.5, 501.5, 2.25, 1.75)


def depth(number):
    counts = np.full((4, 5), 1000 + number, np.uint16)
    counts[0, :2] = 0, 65535
    return counts


def pose(number):
    matrix = np.eye(4)
    angle = 0.3 * number
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = number, 2.0, -3.0
    return matrix


def write_png(file, counts):
    file.write_bytes(cv2.imencode(".png", counts)[1].tobytes())


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "camera-intrinsics.txt").write_text(K)
    (tmp_path / "gravity-direction.txt").write_text("0 1 0\n")
    for number in (0, 4, 12):
        write_png(tmp_path / f"frame-{number:06d}.depth.png", depth(number))
        write_png(tmp_path / f"frame-{number:06d}.color.png", np.zeros((4, 5, 3), np.uint8))
        np.savetxt(tmp_path / f"frame-{number:06d}.pose.txt", pose(number))
    return tmp_path


@dataclass
class Read:
    images: list[DepthImage]
    transforms: list[Transform]
    problems: list[str]


def read(path, **options):
    with DepthFolder(path, **options) as opened:
        messages = list(opened)
        return Read(
            [message for message in messages if isinstance(message, DepthImage)],
            [message for message in messages if isinstance(message, Transform)],
            opened.problems,
        )


def test_images_have_intrinsics_and_stamps_by_their_numbers(folder):
    images = read(folder).images
    assert [image.sequence for image in images] == [0, 4, 12]
    assert [image.stamp_ns for image in images] == [0, 133_333_333, 400_000_000]
    for image in images:
        assert (image.camera, image.unit_m) == (CAMERA, 0.001)
        assert image.depth[0, :2].tolist() == [0, 0]
        assert (image.depth[1:] == 1000 + image.sequence).all()


def test_poses_come_as_matrices_and_before_each_image_as_transforms(folder):
    with DepthFolder(folder) as opened:
        matrices = dict(opened.poses())
        kinds = [type(message) for message in opened]
    assert list(matrices) == [0, 133_333_333, 400_000_000]
    assert matrices[400_000_000] == pytest.approx(pose(12))
    assert kinds == [Transform, DepthImage] * 3
    last = read(folder).transforms[-1]
    assert (last.parent, last.child, last.static) == ("world", "camera_depth_optical_frame", False)
    assert last.translation.tolist() == [12.0, 2.0, -3.0]
    assert Rotation.from_quat(last.quaternion).as_matrix() == pytest.approx(pose(12)[:3, :3])


def test_table_of_contents_and_notes(folder):
    assert is_depth_folder(folder)
    with open_recording(folder) as opened:
        assert [(topic.name, topic.count, topic.decoded) for topic in opened.topics] == [
            ("depth", 3, True),
            ("pose", 3, True),
        ]
        assert (opened.start_ns, opened.end_ns, opened.depth_topic) == (0, 400_000_000, "depth")
        assert opened.metadata == {"depth_folder": {"camera-intrinsics.txt": K, "gravity-direction.txt": "0 1 0\n"}}
        assert (opened.truncated, opened.problems) == (False, [])
        with pytest.raises(RecordingError, match="no scans called '/scan'"):
            opened.messages("/scan")


def test_a_stamps_file_comes_before_the_numbers(folder):
    (folder / "stamps.txt").write_text(
        "# seconds file\n1311868164.363181123 depth/frame-000012.depth.png\n"
        "1311868165.5 frame-000000.depth.png\n\n1311868166 frame-000004.depth.png\n"
    )
    images = read(folder).images
    assert [(image.stamp_ns, image.sequence) for image in images] == [
        (1311868164363181123, 12),
        (1311868165500000000, 0),
        (1311868166000000000, 4),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 frame-000000.depth.png\n", "no stamp for frame-000004.depth.png"),
        ("x y\n", "line 1 is not 'seconds file-name'"),
    ],
)
def test_stamps_that_do_not_fit_are_refused(folder, text, message):
    (folder / "stamps.txt").write_text(text)
    with pytest.raises(RecordingError, match=message):
        DepthFolder(folder)


def test_plain_pngs_are_read_with_an_intrinsics_file_from_elsewhere(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    for number in (2, 10):
        write_png(folder / f"data1_depth_{number}.png", depth(number))
    with pytest.raises(RecordingError, match="depth images without camera-intrinsics.txt: give a file"):
        open_recording(folder)
    (tmp_path / "k.txt").write_text(K)
    with open_recording(folder, intrinsics=tmp_path / "k.txt", depth_unit_m=0.0002) as opened:
        images = list(opened)
    assert [(image.sequence, image.unit_m, image.camera) for image in images] == [
        (2, 0.0002, CAMERA),
        (10, 0.0002, CAMERA),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"1 2 3", "not a 3x3 matrix"),
        (b"a b c", "not a 3x3 matrix"),
        (b"\xff\xfe", "not a text file"),
        (K.replace("500.5", "0").encode(), "no camera"),
        (K.replace("2.25", "320").encode(), r"its centre \(320.0, 1.75\) is outside of images of 5x4 px"),
    ],
)
def test_intrinsics_that_are_none_are_refused(folder, text, message):
    file = folder / "camera-intrinsics.txt"
    file.write_bytes(text)
    with pytest.raises(RecordingError, match=message):
        DepthFolder(folder)


def test_files_that_cannot_be_read_are_counted_and_the_rest_is_read(folder, capfd):
    (folder / "frame-000000.depth.png").write_bytes((folder / "frame-000000.depth.png").read_bytes()[:-9])
    write_png(folder / "frame-000013.depth.png", np.zeros((2, 2), np.uint16))
    (folder / "frame-000004.pose.txt").write_text("nan " * 16)
    (folder / "frame-000012.pose.txt").write_text("1 0 0")
    with DepthFolder(folder) as opened:
        for _ in range(2):
            assert [type(message) for message in opened] == [Transform, DepthImage, DepthImage]
            assert opened.problems == [
                "1 file cannot be read: PNG cut short",
                "1 file cannot be read: a pose file's matrix is no pose",
                "1 file cannot be read: no 4x4 matrix in a pose file",
                "1 file cannot be read: 2x2 px, others 5x4",
            ]
        assert opened.truncated
    assert capfd.readouterr().err == ""


def test_a_folder_without_one_readable_image_is_refused(tmp_path):
    (tmp_path / "camera-intrinsics.txt").write_text(K)
    write_png(tmp_path / "picture_1.png", np.zeros((4, 5, 3), np.uint8))
    with pytest.raises(RecordingError, match="none of its 1 images can be read: PNG, but not of one grey channel"):
        open_recording(tmp_path)


def test_frames_without_a_number_or_with_the_same_are_refused(folder):
    write_png(folder / "other-000012.depth.png", depth(1))
    with pytest.raises(RecordingError, match=r"frame-000012.depth.png and other-000012.depth.png are both frame 12"):
        DepthFolder(folder)
    write_png(folder / "a.depth.png", depth(1))
    with pytest.raises(RecordingError, match="no frame number in its name"):
        DepthFolder(folder)


def test_other_folders_are_none(tmp_path, folder):
    (tmp_path / "empty").mkdir()
    assert not is_depth_folder(tmp_path / "empty")
    assert not is_depth_folder(tmp_path / "missing")
    (folder / "run.mcap").write_bytes(b"")
    assert not is_depth_folder(folder)


@pytest.mark.real_data
def test_real_kinect_frames_with_poses(data_dir):
    with open_recording(data_dir / "sevenscenes_kinect") as opened:
        messages = list(opened)
        poses = list(opened.poses()) if isinstance(opened, DepthFolder) else []
        assert opened.problems == []
    images = [message for message in messages if isinstance(message, DepthImage)]
    assert (len(images), len(poses), len(messages)) == (125, 125, 250)
    assert images[0].camera == Pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)
    assert [image.sequence for image in images] == list(range(0, 500, 4))
    assert max(image.depth.max() for image in images) < 65535
    steps_m = np.linalg.norm(np.diff([matrix[:3, 3] for _, matrix in poses], axis=0), axis=1)
    assert steps_m.max() < 0.3  # a hand moves so far in 0.13 s


@pytest.mark.real_data
def test_real_d435_pngs_are_read_with_given_intrinsics(data_dir, tmp_path):
    (tmp_path / "k.txt").write_text("615 0 320\n0 615 240\n0 0 1\n")
    with open_recording(data_dir / "d435_turntable", intrinsics=tmp_path / "k.txt") as opened:
        images = list(opened)
    assert [image.sequence for image in images] == list(range(6))
    assert all(0.9 < (image.depth > 0).mean() < 1 for image in images)
