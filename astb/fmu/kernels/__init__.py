"""Compiled functions inside of the FMUs."""
