"""The rates of the bench: its tick, the periods of messages, time-outs, and bins of the lateness of a tick."""

import os
from math import inf
from typing import Final, NamedTuple

from bench_protocol.units import kN, mm, mrad, ms, s, us

#: Ticks per second that a rig may have; its compiled tick is made for one of them.
TICK_RATES: Final = (1000, 2000, 5000)
#: The environment variable that selects the rate, read when a process starts.
TICK_RATE_VARIABLE: Final = "ASTB_TICK_RATE"


def _tick_rate() -> int:
    text = os.environ.get(TICK_RATE_VARIABLE, str(TICK_RATES[0]))
    if text not in map(str, TICK_RATES):
        rates = ", ".join(map(str, TICK_RATES))
        raise ValueError(
            f"{TICK_RATE_VARIABLE} = {text!r} is not a tick rate of this rig; use one of {rates} (Hz)"
        )
    return int(text)


TICK_RATE: Final = _tick_rate()
TICK: Final = 1.0 / TICK_RATE

#: Hz; a periodic message of the rig is sent at one of these.
FAST_RATE: Final = 200.0
COMMAND_RATE: Final = 50.0
SLOW_RATE: Final = 10.0
RATES: Final = (FAST_RATE, COMMAND_RATE, SLOW_RATE)

#: Time without a valid command after which the rig holds, and after which it disables itself.
HOLD_AFTER: Final = 100 * ms
DISABLE_AFTER: Final = 500 * ms
#: Speed at which the rig follows a streamed set-point, by its SI unit, per second.
PACE: Final = {"m": 200 * mm / s, "N": 50 * kN / s, "rad": 200 * mrad / s}


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
