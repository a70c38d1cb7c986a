"""Real MAVLink of a vehicle: what our link needs from it, found or named as missing.

The .tlog is an ArduSub's. The two ArduRover files are dataflash logs, the autopilot's own format and no MAVLink:
nothing of them passes a link, so they are read for their parameters alone, by pymavlink's own reader.
"""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from drivers.mavlink_checklist import PARAMETERS, checklist
from drivers.mavlink_codec import MavlinkCodec, read_telemetry_log
from drivers.mavlink_link import OWN_SYSTEM
from drivers.mavlink_report import VehicleReport, is_vehicle
from drivers.messages import Imu

pytest.importorskip("pymavlink")
pytestmark = pytest.mark.real_data

NEEDED = (
    "HEARTBEAT",
    "ATTITUDE",
    "STATUSTEXT",
    "RAW_IMU",
    "SCALED_IMU",
    "WHEEL_DISTANCE",
    "COMMAND_ACK",
    "PARAM_VALUE",
)
MISSING = {
    "SCALED_IMU",
    "WHEEL_DISTANCE",
}  # a submarine has no wheels; the other is the same sensor, sent when asked for
ROVERS = ("erle_pxf_rover_25-8-2014_61.BIN", "erle_pxf_rover_27-8-2014_51.BIN")


@pytest.fixture
def submarine(data_dir: Path) -> list:
    return list(read_telemetry_log((data_dir / "mavlink" / "ardusub_small.tlog").read_bytes()))


def test_every_packet_of_the_log_is_read(submarine, data_dir: Path) -> None:
    size = (data_dir / "mavlink" / "ardusub_small.tlog").stat().st_size
    read = sum(8 + len(message.get_msgbuf()) for _, message in submarine)
    assert read / size > 0.99
    stamps = [stamp for stamp, _ in submarine]
    assert max(a - b for a, b in pairwise(stamps)) < 1e9


def test_a_real_autopilots_stream_means_the_same_to_our_decoder_and_to_our_report(submarine) -> None:
    report, found, decoder = VehicleReport(), Counter[str](), MavlinkCodec(255, 191)
    measured: list = []
    for stamp_ns, message in submarine:
        for heard in decoder.decode(bytes(message.get_msgbuf())):
            found[heard.get_type()] += 1
            if (heard.get_srcSystem(), heard.get_srcComponent()) == (1, 1):
                report.hear(heard, stamp_ns)
                measured += report.take()
    assert found.total() > 0.99 * len(submarine)
    assert report.heartbeat is not None
    assert report.heartbeat.autopilot == 3
    missing = {name for name in NEEDED if not found[name]}
    assert missing == MISSING, f"found: {dict(found)}"
    # It came unasked as RAW_IMU: gravity upwards in our axes, and a turn that agrees with the autopilot's own attitude.
    imu = [message for message in measured if isinstance(message, Imu)]
    assert found["RAW_IMU"] - 5 <= len(imu) <= found["RAW_IMU"]  # those before the first heartbeat are left out
    assert np.median([message.acceleration_mps2[2] for message in imu]) == pytest.approx(9.8, abs=0.5)


def test_turning_speeds_are_those_of_the_autopilots_own_attitude_in_our_axes(submarine) -> None:
    report, attitude, felt, told = VehicleReport(), None, [], []
    for stamp_ns, message in submarine:
        report.hear(message, stamp_ns)
        if message.get_type() == "ATTITUDE":
            attitude = message
        for imu in report.take():
            if isinstance(imu, Imu) and attitude is not None:
                felt.append(imu.angular_velocity_radps)
                told.append((attitude.rollspeed, -attitude.pitchspeed, -attitude.yawspeed))
    assert len(felt) > 500
    for axis in range(3):
        assert np.corrcoef(np.array(felt)[:, axis], np.array(told)[:, axis])[0, 1] > 0.97


def test_ground_stations_in_the_log_are_no_vehicles(submarine) -> None:
    beats = [message for _, message in submarine if message.get_type() == "HEARTBEAT"]
    vehicles = {(m.get_srcSystem(), m.get_srcComponent()) for m in beats if is_vehicle(m)}
    assert vehicles == {(1, 1)}


@pytest.mark.parametrize("name", ROVERS)
def test_real_rovers_parameters(name: str, data_dir: Path) -> None:
    reader = pytest.importorskip("pymavlink.DFReader")
    log = reader.DFReader_binary(str(data_dir / "mavlink" / name))
    parameters = {}
    while (message := log.recv_msg()) is not None:
        if message.get_type() == "PARM":
            parameters[message.Name] = message.Value
    log.filehandle.close()
    known = {name: parameters[name] for name in PARAMETERS if name in parameters}
    assert {"FS_GCS_ENABLE", "FS_TIMEOUT", "FS_ACTION", "SYSID_MYGCS"} <= known.keys()
    assert {"GUID_TIMEOUT", "FS_CRASH_CHECK", "EK3_SRC1_YAW", "VISO_TYPE", "PRX1_TYPE"}.isdisjoint(known)  # of 2014
    assert known["SYSID_MYGCS"] == OWN_SYSTEM
    assert [line for line in checklist(known, OWN_SYSTEM) if "FS_GCS_ENABLE" in line]  # off, as delivered
