"""A recording (simulated) whose bytes are damaged on the way to the decoder is still mapped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.messages import RawChunk
from drivers.recording_reader import open_recording
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import read_tum
from tools.pipeline import LidarDecoding, MappingFlow, look_ahead
from tools.replay_run import recorded_config

BYTE_FAULTS = 0.002  # more than a bad cable; a capsule of 132 bytes is hit every fourth time


def damaged(chunk, random):
    data = np.frombuffer(chunk.data, dtype=np.uint8).copy()
    hit = random.random(len(data)) < BYTE_FAULTS
    data[hit] = random.integers(0, 256, hit.sum())
    return replace(chunk, data=data.tobytes())


@pytest.mark.parametrize("seed", [1, 2])
def test_byte_faults_cost_samples_but_not_the_map(seed, project_root):
    random = np.random.default_rng(seed)
    stem = project_root / "recordings/simulated_office_a2m12"
    with open_recording(stem.with_suffix(".mcap")) as recording:
        config = recorded_config(recording)
        flow = MappingFlow(config, look_ahead(recording.messages(), config).mount)
        decoding = LidarDecoding()
        for message in recording.messages():
            given = damaged(message, random) if isinstance(message, RawChunk) else message
            for decoded in decoding.feed(given):
                flow.feed(decoded)
        flow.finish()
    (counters,) = decoding.counters
    assert counters.rejected_packets > 500
    assert flow.mapper.counters.mapped > 0.85 * flow.scans  # the others have less than a third of their samples
    assert flow.mapper.counters.unmatched == 0
    error = absolute_trajectory_error(flow.mapper.trajectory, read_tum(stem.with_suffix(".truth.tum")))
    # Half the samples are gone: twice the error of the whole stream (1 cm) and a margin.
    assert error.rms_m < 0.04
    assert error.mean_deg < 0.6
