"""Simulation of eight springs in lock-step by vector instructions, for the thousands of replays of a diagnosis."""
