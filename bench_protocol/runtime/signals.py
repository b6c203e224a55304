"""Signals by their names, as far as this system has them."""

import signal


def known(*names: str) -> list[signal.Signals]:
    """Return those of the signals ``names`` that there are; Windows has only a few."""
    return [getattr(signal, name) for name in names if hasattr(signal, name)]
