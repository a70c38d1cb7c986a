"""Errors of the commands themselves; each text is one line with what was found and what to do."""


class ToolError(Exception):
    """A command cannot do what it was asked to; the command line exits with 1."""


class UsageError(ToolError):
    """The command line or the configuration is not usable; the command line exits with 2."""
