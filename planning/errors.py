"""What can go wrong in planning; each text is one line with value, expectation and remedy."""


class PlanningError(Exception):
    """Base of this layer's errors; the command line exits with 1."""


class WorkerError(PlanningError):
    """The process that plans crashed, was killed or could not start; the next request finds another one."""
