from __future__ import annotations

import pytest

from mapping.depth_projection import project
from tools.config import parse
from tools.depth_bench import STAGES, bench_depth, projections, render

CONFIG = parse({"depth": {"width": 424, "height": 240, "fps": 30}}, "test")


def test_frames_are_different_views_of_a_drive():
    rendered = render(CONFIG)
    assert len(rendered.images) == len(rendered.poses) > 10
    assert (rendered.images[0] != rendered.images[-1]).mean() > 0.2
    assert rendered.images[0].shape == (240, 424)


def test_numpy_s_projection_is_always_measured():
    assert projections()["numpy"]() is project


@pytest.mark.live
def test_stages_add_up_and_frames_come_at_the_camera_s_pace():
    cost = bench_depth("numpy", CONFIG, 1.0)
    assert set(cost.cpu_ms) == set(STAGES)
    assert cost.frames + cost.lost_frames == pytest.approx(30 * cost.seconds, abs=4)
    assert 0.0 < sum(cost.cpu_share.values()) <= cost.process_share + 0.02
    assert cost.latency_ms.median > 0.0
