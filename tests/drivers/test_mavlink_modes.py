"""Modes by name and number."""

import pytest

from drivers.mavlink_constants import Autopilot
from drivers.mavlink_modes import ARDUROVER, PX4, mode_name, modes_of


@pytest.mark.parametrize(("autopilot", "modes"), [(Autopilot.ARDUPILOT, ARDUROVER), (Autopilot.PX4, PX4)])
def test_the_guided_mode_is_called_so_by_both(autopilot: int, modes) -> None:
    assert modes_of(autopilot) == modes
    main, sub = modes.guided
    custom = main if autopilot == Autopilot.ARDUPILOT else main << 16 | sub << 24
    assert mode_name(autopilot, custom) == modes.guided_name


def test_other_names() -> None:
    assert mode_name(Autopilot.ARDUPILOT, 4) == "HOLD"
    assert mode_name(Autopilot.ARDUPILOT, 77) == "mode 77"
    assert mode_name(Autopilot.PX4, 4 << 16 | 3 << 24) == "HOLD"
    assert mode_name(Autopilot.PX4, 1 << 16) == "MANUAL"
