"""The pace of the bench: its tick, how often messages are sent, how long it waits, and how late a tick may be."""

from math import inf
from typing import Final, NamedTuple

from bench_protocol.units import ms, us

TICK: Final = 1 * ms

#: Hz; a periodic message of the rig is sent at one of these.
FAST_RATE: Final = 200.0
COMMAND_RATE: Final = 50.0
SLOW_RATE: Final = 10.0
RATES: Final = (FAST_RATE, COMMAND_RATE, SLOW_RATE)

#: How long the rig waits for a valid command until it holds, and until it disables itself.
HOLD_AFTER: Final = 100 * ms
DISABLE_AFTER: Final = 500 * ms


class LatenessBin(NamedTuple):
    """One bin of the histogram of the ticks' lateness; its counter is ``rig.lateness_<name>``."""

    name: str
    edge: float  #: s, where it ends
    text: str

    @property
    def signal(self) -> str:
        """The name of its counter in the table of signals."""
        return f"rig.lateness_{self.name}"


LATENESS_BINS: Final = (
    LatenessBin("50us", 50 * us, "less than 50 us"),
    LatenessBin("100us", 100 * us, "50 to 100 us"),
    LatenessBin("250us", 250 * us, "100 to 250 us"),
    LatenessBin("500us", 500 * us, "250 to 500 us"),
    LatenessBin("1ms", 1 * ms, "0.5 to 1 ms"),
    LatenessBin("more", inf, "1 ms or more"),
)
