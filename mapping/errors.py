"""What can go wrong with mapping's files and inputs; each text is one line with value, expectation and remedy."""


class MappingError(Exception):
    """Base of this layer's errors; the command line exits with 1."""


class TrajectoryError(MappingError):
    """A trajectory file cannot be used."""


class MapFileError(MappingError):
    """A map file (YAML, image or grid) cannot be used."""


class RelationsError(MappingError):
    """A relations file cannot be used, or does not belong to the trajectory."""


class TruthError(MappingError):
    """A file of ground truth holds nothing that a trajectory can be scored against."""


def unreadable(error: OSError | UnicodeDecodeError) -> str:
    """Return in words why a text file could not be read."""
    return "it is no text" if isinstance(error, UnicodeDecodeError) else error.strerror or str(error)
