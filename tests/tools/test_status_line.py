from __future__ import annotations

from drivers.vehicle import VehicleState
from tools.status_line import StatusLine


def test_a_line_a_second_and_what_is_the_same_every_ten():
    said: list[str] = []
    line = StatusLine(said.append)
    ways = [f"{20.0 - 0.05 * n:.0f} m" for n in range(60)] + ["standing"] * 240  # 15 s of ticks
    for n, words in enumerate(ways):
        line.tell(0.05 * n, words.__str__)
    assert said == ["20 m", "19 m", "18 m", "standing", "standing"]


def test_the_vehicle_is_told_of_when_it_changes():
    said: list[str] = []
    line = StatusLine(said.append)
    for armed, mode in ((False, "MANUAL"), (False, "MANUAL"), (True, "GUIDED"), (True, "GUIDED")):
        line.vehicle(VehicleState(0, armed, mode, armed))
    assert said == ["vehicle: disarmed, mode MANUAL", "vehicle: armed, mode GUIDED"]
