"""Faults on purpose: what can be broken on a running rig, by name, and repaired again."""
