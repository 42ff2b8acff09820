"""Scenarios, co-simulation loop, acceptance, metrics, reports and the command line."""
