"""The camera driver, unmodified, over the emulated camera in simulated time: every fault ends as it should."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass, field
from itertools import count, islice
from pathlib import Path

import numpy as np
import pytest

from drivers import v4l2
from drivers.d435_calibration import CalibrationSource
from drivers.d435_controls import D435Controls
from drivers.d435_emulated_firmware import EmulatedFirmware, emulated_pinhole
from drivers.d435_emulated_stream import Images, StreamFaults
from drivers.d435_emulator import D435Emulator, NodeState
from drivers.depth_camera import DepthCounters, DepthMode, open_depth_camera
from drivers.emulated_link import SimulatedClock
from drivers.errors import (
    DeviceFaultError,
    DeviceLostError,
    PortBusyError,
    PortMissingError,
    PortPermissionError,
    RecordingError,
    WrongDeviceError,
)

SMALL = DepthMode(424, 240, 90)
START_NS = 3_000_000_000
OFFSET_NS = 1_700_000_000_000_000_000


def numbered():
    """Images whose every pixel is the frame's number."""
    return (np.full((240, 424), number, np.uint16) for number in count())


@dataclass
class Bench:
    """An emulated camera in simulated time."""

    faults: StreamFaults = StreamFaults()
    firmware: EmulatedFirmware = field(default_factory=EmulatedFirmware)
    images: Images | None = None

    def __post_init__(self):
        self.clock = SimulatedClock(START_NS)
        self.emulator = D435Emulator(
            numbered() if self.images is None else self.images,
            firmware=self.firmware,
            faults=self.faults,
            clock=self.clock,
            sleep=self.clock.sleep,
        )

    def open(self, mode=SMALL, **options):
        return open_depth_camera(self.emulator.path, mode, calls=self.emulator, **options)


def numbers(images):
    return [int(image.depth[0, 0]) for image in images]


@pytest.mark.parametrize("mode", [DepthMode(), SMALL, DepthMode(640, 480, 60), DepthMode(848, 100, 300)])
def test_every_frame_arrives_whole_in_order_and_with_its_time(mode):
    rng = np.random.default_rng(mode.width)
    sent = rng.integers(0, 1 << 16, (5, mode.height, mode.width), dtype=np.uint16)
    bench = Bench(images=sent)
    with bench.open(mode, wall_offset_ns=OFFSET_NS) as camera:
        received = list(islice(camera, 5))
    assert np.array_equal([image.depth for image in received], sent)
    assert [image.sequence for image in received] == [0, 1, 2, 3, 4]
    due_ns = OFFSET_NS + START_NS + np.arange(1, 6) * 1e9 / mode.fps
    assert [image.stamp_ns for image in received] == pytest.approx(due_ns, abs=2000), "whole microseconds"
    assert {image.unit_m for image in received} == {0.001}
    assert camera.counters == DepthCounters(frames=5)
    assert not bench.emulator.firmware.refused


def test_images_live_on_after_the_camera_is_closed():
    with Bench().open() as camera:
        images = list(islice(camera, 12))
    assert numbers(images) == list(range(12)), "each has its own memory, not the kernel's"


def test_the_camera_says_who_it_is_and_what_its_intrinsics_are():
    with Bench().open(DepthMode(640, 480, 30)) as camera:
        info = camera.info
    assert info.version.firmware == "5.12.7.100"
    assert info.calibration.source is CalibrationSource.RECTIFICATION
    expected = emulated_pinhole((640, 480))
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(info.calibration.camera, name) == pytest.approx(getattr(expected, name), rel=1e-6)


def test_damaged_frames_are_dropped_and_counted():
    bench = Bench(StreamFaults(flagged=frozenset({2, 3}), short=frozenset({5})))
    with bench.open() as camera:
        assert numbers(islice(camera, 5)) == [0, 1, 4, 6, 7]
    assert camera.counters == DepthCounters(frames=5, flagged_frames=2, short_frames=1)


def test_gaps_in_the_frame_numbers_are_counted():
    bench = Bench(StreamFaults(gaps={1: 3, 4: 1}))
    with bench.open() as camera:
        images = list(islice(camera, 6))
    assert numbers(images) == [0, 1, 2, 3, 4, 5]
    assert [image.sequence for image in images] == [0, 4, 5, 6, 8, 9]
    assert camera.counters == DepthCounters(frames=6, gaps=2, lost_frames=4)


def test_frame_numbers_may_wrap_around():
    bench = Bench(StreamFaults(gaps={0: 2**32 - 2}))
    with bench.open() as camera:
        assert [image.sequence for image in islice(camera, 4)] == [2**32 - 2, 2**32 - 1, 0, 1]
    assert camera.counters == DepthCounters(frames=4)


def test_a_slow_consumer_loses_frames_and_knows_how_many():
    bench = Bench()
    with bench.open() as camera:
        received = []
        for image in islice(camera, 8):
            received.append(image)
            if len(received) == 1:
                bench.clock.sleep(1.0)
        kept = numbers(received)
    assert kept[:5] == [0, 1, 2, 3, 4], "what fits into the buffers waits"
    assert camera.counters.lost_frames == kept[5] - 5 == 90 - 4, "due in a second, less those in the buffers"
    assert camera.counters.gaps == 1


def test_unplugging_ends_in_a_typed_error_after_the_frames_before_it():
    bench = Bench(StreamFaults(unplug_at=4))
    with bench.open() as camera, pytest.raises(DeviceLostError, match="/dev/video0: the camera went away"):
        list(camera)
    assert camera.counters == DepthCounters(frames=4)


def test_a_camera_that_comes_back_is_opened_again():
    bench = Bench()
    with bench.open() as camera:
        frames = iter(camera)
        assert next(frames).sequence == 0
        bench.emulator.unplug()
        with pytest.raises(DeviceLostError):
            list(frames)
    with pytest.raises(PortMissingError, match="no such camera"):
        bench.open()
    bench.emulator.plug_in()
    with bench.open() as camera:
        assert next(iter(camera)).sequence == 0


def test_silence_ends_in_a_typed_error_after_two_seconds():
    bench = Bench(StreamFaults(silent_from=3))
    with bench.open() as camera, pytest.raises(DeviceLostError, match=r"no frame for 2\.\d s during streaming"):
        list(camera)
    assert camera.counters.frames == 3
    assert (bench.clock() - START_NS) * 1e-9 == pytest.approx(2.0 + 4 / 90, abs=0.3)


def test_a_camera_that_never_sends_is_a_fault_after_five_seconds():
    bench = Bench(StreamFaults(silent_from=0))
    with bench.open() as camera, pytest.raises(DeviceFaultError, match=r"streaming, but no frame within 5\.\d s"):
        list(camera)
    assert (bench.clock() - START_NS) * 1e-9 == pytest.approx(5.0, abs=0.3)


def test_nothing_but_damaged_frames_is_a_fault():
    bench = Bench(StreamFaults(flagged=frozenset(range(2, 2000))))
    with bench.open() as camera, pytest.raises(DeviceFaultError, match="only damaged frames for 5 s"):
        list(camera)
    assert camera.counters.frames == 2
    assert camera.counters.flagged_frames == pytest.approx(5 * 90, abs=2)


def test_the_time_that_the_consumer_takes_is_not_silence():
    bench = Bench()
    with bench.open() as camera:
        for _ in islice(camera, 3):
            bench.clock.sleep(30.0)
    assert camera.counters.frames == 3


def test_a_camera_that_is_not_ready_is_asked_again():
    bench = Bench(firmware=EmulatedFirmware(not_ready=6))
    with bench.open() as camera:
        assert camera.info.calibration.source is CalibrationSource.RECTIFICATION
        assert camera.info.calibration.notes == ()


def test_a_camera_that_never_gets_ready_is_a_typed_error_and_is_closed():
    bench = Bench(firmware=EmulatedFirmware(not_ready=10_000))
    for _ in range(2):  # a node left open would refuse the second
        with pytest.raises(DeviceFaultError, match="not ready"):
            bench.open()


def test_the_depth_unit_of_the_camera_is_used():
    with Bench(firmware=EmulatedFirmware(unit_um=100)).open() as camera:
        assert next(iter(camera)).unit_m == pytest.approx(1e-4)


@pytest.mark.parametrize("mode", [SMALL, DepthMode(848, 100, 100), DepthMode(256, 144, 90)])
def test_old_firmware_is_calibrated_by_its_table_to_the_same_intrinsics(mode):
    with Bench().open(mode) as new, Bench(firmware=EmulatedFirmware(rectification=False)).open(mode) as old:
        assert old.info.calibration.source is CalibrationSource.TABLE
        assert "unknown command" in old.info.calibration.notes[0]
        if mode is SMALL:
            assert old.info.calibration.camera == new.info.calibration.camera


def test_a_damaged_table_is_never_used():
    firmware = EmulatedFirmware(rectification=False, sound_table=False)
    with Bench(firmware=firmware).open() as camera:
        calibration = camera.info.calibration
    assert calibration.source is CalibrationSource.NOMINAL
    assert "CRC-32" in calibration.notes[1]


def test_a_damaged_table_gives_way_to_the_file(tmp_path):
    firmware = EmulatedFirmware(rectification=False, sound_table=False)
    with Bench(firmware=firmware).open(camera_info=camera_info(tmp_path)) as camera:
        assert camera.info.calibration.source is CalibrationSource.FILE
        assert camera.info.calibration.camera.fx == 250.0


@pytest.mark.parametrize(
    ("state", "kind", "text"),
    [
        (NodeState.MISSING, PortMissingError, "no such camera"),
        (NodeState.FORBIDDEN, PortPermissionError, "group video"),
        (NodeState.BUSY, PortBusyError, "fuser -v /dev/video0"),
    ],
)
def test_a_camera_that_cannot_be_used_says_why_and_can_be_used_later(state, kind, text):
    bench = Bench()
    bench.emulator.state = state
    with pytest.raises(kind, match=text):
        bench.open()
    bench.emulator.state = NodeState.PRESENT
    bench.open().close()


def test_a_mode_that_is_not_offered_lists_the_others():
    with pytest.raises(DeviceFaultError, match=r"848x480@6/15/30/60/90.*USB 2"):
        Bench().open(DepthMode(848, 480, 42))


def test_controls_are_set_and_a_fixed_exposure_moves_the_stamp_to_its_middle():
    bench = Bench()
    with bench.open(controls=D435Controls(emitter=False, exposure_us=8000, laser_power_mw=0)) as camera:
        stamp_ns = next(iter(camera)).stamp_ns
    assert [bench.firmware.control(selector) for selector in (2, 3, 4, 0xB)] == [0, 8000, 0, 0]
    assert stamp_ns == pytest.approx(START_NS + 1e9 / 90 - 4e6, abs=1000)


def test_request_stop_ends_the_iteration_and_it_can_begin_anew():
    bench = Bench()
    with bench.open() as camera:
        seen = 0
        for _ in camera:
            seen += 1
            if seen == 5:
                camera.request_stop()
        assert seen == 5
        camera.stop()
        camera.stop()
        camera.start()
        assert next(iter(camera)).sequence == 0
    camera.close()


def test_a_stop_that_is_requested_before_the_first_frame_is_obeyed():
    with Bench().open() as camera:
        camera.request_stop()
        assert list(camera) == []


class Foreign:
    """System calls over the emulated camera that make another one of it, or another behaviour of the kernel's."""

    def __init__(self, emulator, card=None, padding=0, clock_flag=True, spurious=0):
        self._emulator = emulator
        self._card, self._padding, self._clock_flag, self._spurious = card, padding, clock_flag, spurious

    def __getattr__(self, name):
        return getattr(self._emulator, name)

    def wait_readable(self, descriptor, timeout_s):
        if self._spurious:
            self._spurious -= 1
            return True
        return self._emulator.wait_readable(descriptor, timeout_s)

    def ioctl(self, descriptor, request, argument):
        if request == v4l2.UVC_CONTROL_QUERY and self._card:
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
        self._emulator.ioctl(descriptor, request, argument)
        if request == v4l2.QUERYCAP and self._card:
            argument[16:48] = self._card.ljust(32, b"\0")
        if request == v4l2.S_FMT:
            stride = int.from_bytes(argument[24:28], "little") + self._padding
            argument[24:28] = stride.to_bytes(4, "little")
        if request == v4l2.DQBUF and not self._clock_flag:
            argument[12:16] = bytes(4)


def camera_info(folder: Path) -> Path:
    path = folder / "camera.yaml"
    matrix = "[500, 0, 423.5, 0, 500, 239.5, 0, 0, 1]"
    path.write_text(f"image_width: 848\nimage_height: 480\ncamera_matrix: {{data: {matrix}}}\n", encoding="utf-8")
    return path


def test_a_camera_info_that_is_not_there_is_refused_even_by_a_camera_that_tells(tmp_path):
    with pytest.raises(RecordingError, match=r"none\.yaml: there is no such camera_info file"):
        Bench().open(camera_info=tmp_path / "none.yaml")


def test_another_depth_camera_works_with_its_camera_info(tmp_path):
    bench = Bench()
    calls = Foreign(bench.emulator, card=b"ToF")
    with open_depth_camera("/dev/video0", SMALL, camera_info=camera_info(tmp_path), calls=calls) as camera:
        image = next(iter(camera))
    assert (camera.info.card, camera.info.version) == ("ToF", None)
    assert camera.info.calibration.source is CalibrationSource.FILE
    assert (image.camera.fx, image.unit_m) == (250.0, 0.001)


def test_another_depth_camera_without_a_file_or_with_controls_is_refused(tmp_path):
    calls = Foreign(Bench().emulator, card=b"ToF")
    with pytest.raises(WrongDeviceError, match="ToF .*give its camera_info YAML"):
        open_depth_camera("/dev/video0", SMALL, calls=calls)
    with pytest.raises(WrongDeviceError, match="ToF has no emitter"):
        open_depth_camera(
            "/dev/video0",
            SMALL,
            controls=D435Controls(emitter=False),
            camera_info=camera_info(tmp_path),
            calls=calls,
        )


def test_a_node_with_another_clock_is_stamped_on_reading():
    bench = Bench()
    with open_depth_camera("/dev/video0", SMALL, calls=Foreign(bench.emulator, clock_flag=False)) as camera:
        for image in islice(camera, 3):
            assert image.stamp_ns == bench.clock()


def test_a_node_that_says_readable_and_has_nothing_is_waited_for():
    bench = Bench()
    with open_depth_camera("/dev/video0", SMALL, calls=Foreign(bench.emulator, spurious=20)) as camera:
        assert next(iter(camera)).sequence == 0


def test_a_line_that_is_longer_than_its_pixels_makes_a_frame_short_of_them_short():
    bench = Bench(StreamFaults(unplug_at=3))
    with open_depth_camera("/dev/video0", SMALL, calls=Foreign(bench.emulator, padding=16)) as camera:
        with pytest.raises(DeviceLostError):
            list(camera)
        assert camera.counters == DepthCounters(short_frames=3)
