"""Simulated faults: faults of a running rig that can be switched on and off by name."""
