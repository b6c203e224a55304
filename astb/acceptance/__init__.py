"""Acceptance of a rig before plans run on it: checks of its wiring, its answers and its reactions to commands."""
