"""Exit codes of the command line."""

from enum import IntEnum


class ExitCode(IntEnum):
    """What a command's exit status says."""

    OK = 0
    FAILED = 1
    USAGE = 2
    PARTIAL = 3  # done, but not all of it: a truncated recording, mapped as far as it goes
    DEVICE = 4
    CUT_OFF = 130
