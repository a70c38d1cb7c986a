"""One file per command; each wraps one function and imports what is heavy only when it is called."""
