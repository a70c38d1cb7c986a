"""Several maps into one: registration, verification and fusion; a named room that the next release fills."""
