"""Simulation of eight springs at the same time by vector instructions, for the thousands of replays of a diagnosis."""
