"""Faults on purpose: what can be broken on a running rig, by name, and mended again."""
