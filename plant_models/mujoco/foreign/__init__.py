"""Somebody else's car in MuJoCo's format (MJCF) as a plant: found by its structure, driven by its own actuators."""
