"""What goes on within a communication step: displacements, with the speeds and accelerations given with them."""

from typing import Any, Final

from bench_sim.model.compiled import compiled

#: Displacements of a motion; their speeds and accelerations stand behind them.
WAYS: Final = 3


@compiled
def gone_on(motion: Any, place: int, rate: int, since: float) -> float:
    """One displacement of a ``motion`` that was given ``since`` s ago or, where ``rate`` is 1, its speed."""
    speed, acceleration = motion[place + WAYS], motion[place + 2 * WAYS]
    if rate == 1:
        return speed + since * acceleration
    return motion[place] + since * (speed + 0.5 * since * acceleration)
