from __future__ import annotations

import inspect

from mapping import errors


def test_one_base_catches_every_error_of_the_layer() -> None:
    found = [error for _, error in inspect.getmembers(errors, inspect.isclass) if error.__module__ == errors.__name__]
    assert errors.MapFileError in found
    assert all(issubclass(error, errors.MappingError) for error in found)
