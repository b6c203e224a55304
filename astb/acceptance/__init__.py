"""Acceptance of a rig before plans run on it: can its wiring be, and what does it do when it is asked."""
