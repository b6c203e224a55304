"""Least squares on what a simulator predicts: points, replays, linearisations, fits, predictions."""
