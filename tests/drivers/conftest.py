"""What the tests of a QCar share: its board in a process of its own, on a fake of Quanser's API."""

from collections.abc import Callable, Iterator

import pytest

from drivers.qcar_link import GuardedBoard
from tests.drivers.fake_qcar import DEADLINE_S, FAKE_API


@pytest.fixture
def qcar_writes(tmp_path, monkeypatch, project_root) -> Callable[[], list[tuple[float, str]]]:
    """What the fake was told: time on the monotonic clock, and the throttle or `terminated`."""
    file = tmp_path / "throttle"
    file.touch()
    monkeypatch.setenv("FAKE_QCAR_LOG", str(file))
    monkeypatch.setenv("PYTHONPATH", str(project_root))

    def read():
        lines = [line.split() for line in file.read_text().splitlines()]
        return [(float(stamp), what) for stamp, what in lines]

    return read


@pytest.fixture
def qcar_board(qcar_writes) -> Iterator[GuardedBoard]:
    board = GuardedBoard(DEADLINE_S, 0.3, api=FAKE_API)
    yield board
    board.terminate()
