"""Measured logs held against the models: scores, envelope, replay, report."""
