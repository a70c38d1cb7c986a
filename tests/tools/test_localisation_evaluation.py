from __future__ import annotations

import numpy as np
import pytest

from mapping.trajectory import Trajectory
from tools.config import Config
from tools.localisation_evaluation import TrackedDrive, summary, table_of, track
from tools.mapped_drives import map_by_lidar
from tools.simulated_drive import OFFICE_ROUND
from tools.simulator import drive_along
from tools.solid_world import solid
from tools.world import office


def test_the_drive_that_made_the_map_is_followed_on_it():
    whole, world, config = drive_along(OFFICE_ROUND), solid(office()), Config()
    truth = Trajectory(whole.stamps_ns[:120], whole.poses[:120])  # 6 s
    mapped = map_by_lidar(world, truth, config, 0)
    tracked = track(world, mapped, truth, config, 1)
    assert len(tracked.error_m) > 30
    assert tracked.error_m.max() < 0.04
    assert tracked.away_m.max() < 0.1
    assert tracked.cpu_ms > 0.0


def test_the_summary_tells_where_the_car_fits_from_elsewhere():
    one = TrackedDrive(
        error_m=np.array([0.01, 0.03, 0.2]),
        error_rad=np.array([0.0, 0.1, 0.0]),
        chi2=np.array([1.0, 2.0, 9.0]),
        away_m=np.array([0.1, 0.7, 0.2]),
        fits=np.array([True, True, False]),
        cpu_ms=2.0,
    )
    report = summary([one])
    assert report["fits"]["places"] == 2
    assert report["fits"]["error_m_max"] == 0.03
    assert report["fits"]["error_m_rms"] == pytest.approx(np.sqrt((0.01**2 + 0.03**2) / 2))
    assert report["fits"]["error_deg_max"] == pytest.approx(np.degrees(0.1))
    assert [(each["from_m"], each["places"]) for each in report["fits"]["away"]] == [(0.0, 1), (0.5, 1)]
    assert report["elsewhere"]["error_m_max"] == 0.2
    assert "0.200 m" in table_of(report)[-1]
    one_place = np.ones(1)
    at_home = TrackedDrive(one_place, one_place, one_place, one_place, np.ones(1, np.bool_), 1.0)
    assert "elsewhere" not in summary([at_home])
