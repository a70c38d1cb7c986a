"""Two maps of unknown relative pose into one: Algorithm 3 of the thesis, one module a stage."""
