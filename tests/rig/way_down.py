"""The way down and the way back: what may be lost, what must hold meanwhile, and how a commander returns to OFF."""

import numpy as np
import pytest

from bench_protocol.can_codec import Samples
from bench_protocol.rates import FAST_RATE
from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm
from bench_protocol.words import SIDES, LimitKind
from bench_sim.rig.limits import LIMITS, Limit
from bench_sim.rig.rig import Rig
from tests.rig.conftest import Commander

#: What a reading may go past its limit by: what moves needs a way to stop.
ALLOWANCE = {"height": 8 * mm, "displacement": 8 * mm, "pressure": 0.1 * bar, "force": 8 * kN}
WAY_DOWN = 60_000  # ticks
SPANS = [limit for limit in LIMITS if limit.kind in (LimitKind.LOWER, LimitKind.UPPER)]
#: A limit is broken by what lies outside for as long as the limit itself asks for. A bolster that is driven onto a stop
#: meets it with all that the hydraulics give, 200 kN, and bounces on it until the relief valves have taken it back.
PERSISTENCE = {"height": 4, "displacement": 4, "pressure": 4, "force": 60}  # samples
assert all(round(limit.persistence * FAST_RATE) == 4 for limit in SPANS)
#: Samples at the end of a stretch that may be the beginning of so many in a row.
_END = slice(1 - max(PERSISTENCE.values()), None)

VERTICAL = [f"vertical_{side}" for side in SIDES]


class LimitWatch:
    """Looks at all samples that come by, and fails when a reading has broken its limit; those of ``but`` may lie."""

    def __init__(self, but: frozenset[str] = frozenset()) -> None:
        self.but = but
        self._spans = [limit for limit in SPANS if limit.signal not in but]
        self._last: dict[str, np.ndarray] = {limit.signal: np.zeros(0) for limit in self._spans}
        self._low, self._high = np.full(len(TABLE.index), -np.inf), np.full(len(TABLE.index), np.inf)
        for limit in self._spans:
            bounds = self._low if limit.kind is LimitKind.LOWER else self._high
            bounds[TABLE.index[limit.signal]] = _bound(limit)
        self._all_within = True  # of the last readings

    def look(self, samples: Samples) -> None:
        """Look at the samples of the next stretch of time."""
        low, high = self._low[samples.signals], self._high[samples.signals]
        if self._all_within and ((samples.values >= low) & (samples.values <= high)).all():
            return  # as nearly always, and ten times as fast
        course = {
            signal: np.concatenate((last, samples.values[samples.signals == TABLE.index[signal]]))
            for signal, last in self._last.items()
        }
        self._last = {signal: readings[_END] for signal, readings in course.items()}
        self._all_within = True
        for limit in self._spans:
            samples_in_a_row = PERSISTENCE[_quantity(limit)]
            readings = course[limit.signal]
            lower, bound = limit.kind is LimitKind.LOWER, _bound(limit)
            outside = ~(readings >= bound if lower else readings <= bound)  # also for NaN
            self._all_within &= not outside[_END].any()
            if np.count_nonzero(outside) < samples_in_a_row:
                continue
            together = np.convolve(outside, np.ones(samples_in_a_row), "valid")
            assert together.max(initial=0) < samples_in_a_row, (
                f"{limit.signal} is beyond {TABLE[limit.signal].show(limit.at)}: "
                f"{', '.join(TABLE[limit.signal].show(value) for value in readings[outside][:6])} …"
            )


def _quantity(limit: Limit) -> str:
    return limit.signal.split(".")[1].split("_")[-1]


def _bound(limit: Limit) -> float:
    """Return how far a reading may go past its limit."""
    slack = ALLOWANCE[_quantity(limit)]
    return limit.at - slack if limit.kind is LimitKind.LOWER else limit.at + slack


class WatchedCommander(Commander):
    """A commander of whose rig no limit may ever break, whatever it does."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self.watch = LimitWatch()

    def wait(self, ticks: int) -> None:
        self.watch.look(self.decoder.decode(self.rig.run(ticks)))


def go_silent(commander) -> None:
    """The commander is there and says no more."""


def lose_can(commander) -> None:
    commander.rig.peer_lost(commander.peer)


def press_estop(commander) -> None:
    commander.rig.press_estop()


def cut_power(commander) -> None:
    commander.rig.cut_power()


def disable(commander) -> None:
    assert commander.coil("disable")[0] == 5


def black_hole(commander) -> None:
    """The connection of the commander to Modbus stays open and says no more; its frames still come."""
    assert commander.ask(b"\x06\0\1\0\xc8")[0] == 6, "a watchdog of 200 ms"
    commander.cycle(15)


LOSSES = {act.__name__: act for act in (go_silent, lose_can, black_hole, press_estop, cut_power, disable)}


def way_down(commander, ticks: int = WAY_DOWN) -> None:
    """Wait until the springs are empty and the actuators released; every limit is kept meanwhile."""
    watch = LimitWatch()
    for _ in range(ticks // 500):
        watch.look(commander.decoder.decode(commander.rig.run(500)))
        if is_safe(commander):
            return
    pytest.fail(f"after {ticks / 1000:g} s the bench is {summary(commander)}")


def is_safe(commander) -> bool:
    pressure = [
        commander.read(f"{side}.{part}_pressure") for side in SIDES for part in ("bellows", "auxiliary")
    ]
    force = [commander.read(f"{name}.force") for name in (*VERTICAL, "lateral")]
    return max(pressure) < 0.1 * bar and np.abs(force).max() < 1 * kN


def summary(commander) -> str:
    pressures = [f"{commander.read(f'{side}.bellows_pressure') / bar:.2f} bar" for side in SIDES]
    heights = [f"{commander.read(f'{side}.height') / mm:.0f} mm" for side in SIDES]
    forces = [f"{commander.read(f'{name}.force') / kN:.1f} kN" for name in VERTICAL]
    return f"{commander.state}, {', '.join((*heights, *pressures, *forces))}"


def way_back(commander) -> None:
    """Return to OFF by commands over the wires alone (and the hand that releases the stop button)."""
    commander.rig.release_estop()
    commander.take_lease()
    for _ in range(4):
        commander.cycle(2, control_enable=1, control_hold=0, control_active=0, control_reset=0)
        if commander.state == "DISABLED":
            break
        if commander.state == "OFF":
            assert commander.coil("power_on")[0] == 5
            commander.cycle(30)
        elif commander.state in ("FAULT_HOLD", "HOLD", "ACTIVE", "AIR_LOW", "AIR_HIGH"):
            commander.coil("disable")
        else:
            commander.cycle(2, control_reset=1)
    assert commander.state == "DISABLED", summary(commander)
    way_down(commander)
    assert commander.coil("power_off")[0] == 5
    commander.wait(20)
    assert commander.state == "OFF"
