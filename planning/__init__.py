"""Paths that the car can drive on a map: planner and follower; a named room that the next release fills."""
