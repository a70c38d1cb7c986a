"""Paths that a car can drive on an occupancy grid: OMPL's planners on the car's own footprint and turning circle."""
