"""A cancelled number is seen through every view of the same memory."""

from __future__ import annotations

import os
import subprocess
import sys

from planning.cancel_flag import CancelFlag


def test_requests_up_to_the_cancelled_one_are_no_longer_wanted():
    with CancelFlag() as flag:
        assert not flag.is_cancelled(1)
        flag.cancel(3)
        assert [flag.is_cancelled(number) for number in (1, 3, 4)] == [True, True, False]


def test_another_process_sees_it(project_root):
    program = (
        "import sys; from planning.cancel_flag import CancelFlag; print(CancelFlag(int(sys.argv[1])).is_cancelled(7))"
    )
    with CancelFlag() as flag:
        flag.cancel(7)
        seen = subprocess.run(
            [sys.executable, "-c", program, str(flag.descriptor)],
            pass_fds=(flag.descriptor,),
            env={**os.environ, "PYTHONPATH": str(project_root)},
            capture_output=True,
            text=True,
            check=True,
        )
    assert seen.stdout == "True\n"


def test_closing_twice_releases_once():
    before = os.listdir("/proc/self/fd")  # noqa: PTH208
    flag = CancelFlag()
    flag.close()
    flag.close()
    assert len(os.listdir("/proc/self/fd")) == len(before)  # noqa: PTH208
