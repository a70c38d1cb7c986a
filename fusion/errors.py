"""What can go wrong in fusion; each text is one line with value, expectation and remedy."""


class FusionError(Exception):
    """Base of this layer's errors; the command line exits with 1."""
