"""Whole rigs, driven from outside: a package, so that a rig which many tests share lives no longer than it."""
