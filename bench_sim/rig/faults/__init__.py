"""Simulated faults of a running rig. Each is switched on and off by its name."""
