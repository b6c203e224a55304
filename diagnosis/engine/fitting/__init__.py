"""Least squares with a simulator: points, replays, linearisations, fits, predictions."""
