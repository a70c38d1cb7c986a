"""Sensors and their wire formats: stamped messages, devices, emulators and recordings."""
