"""Preconditions of a plan. Each is checked on the connected bench before any motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from math import inf, isnan
from typing import TYPE_CHECKING, Final

from bench_protocol.clock import VirtualClock, utc_date
from bench_protocol.units import NS, K, bar, minutes, s
from drivers.errors import BenchTimeout

if TYPE_CHECKING:
    from test_plans.run import Run

#: 0 °C.
ICE: Final = 273.15 * K
YES: Final = "yes"
NO: Final = "no"
SUPPLY_WITHIN: Final = 5 * s
#: Excess of the supply pressure over the pressure of a spring, to fill it in a reasonable time.
HEADROOM: Final = 1 * bar
#: Temperatures of the hall for which the limits of a specimen hold, because rubber and gas depend on temperature.
HALL: Final = (ICE + 10 * K, ICE + 35 * K)
NO_DAY: Final = "a run in virtual time has no date, so due dates are not checked"
COME_BACK: Final = 1 * minutes
COLD_FROM_BEFORE: Final = (
    "gas that remains in the springs after venting is cold and needs some 5 min to warm up: wait, "
    "and start again"
)
#: Placeholder for the load case that the parameter of this name of the plan gives.
PARAMETER: Final = "load"
_LOOK_WITHIN: Final = 10 * minutes


@dataclass(frozen=True, slots=True)
class ConditionResult:
    """Result of the check of a precondition: met, not met or unknown (None), and a text with the state found and the
    remedy.
    """

    met: bool | None
    found: str


@dataclass(frozen=True, slots=True)
class Precondition:
    """A condition as text, and the function that checks it.

    An unknown result blocks the plan only if the precondition is ``strict``. A precondition with ``armed`` is checked
    on the armed bench, with set-points equal to the measured values: nothing moves, and the bench is disarmed again.
    """

    text: str
    look: Callable[[Run], ConditionResult]
    strict: bool = True
    armed: bool = False


def supply(at_least: float) -> Precondition:
    """Return a precondition: the air supply downstream of the main valve must have the gauge pressure ``at_least``
    (Pa).
    """

    def look(run: Run) -> ConditionResult:
        if lacking := run.bench.lacks("supply.pressure"):
            return ConditionResult(None, lacking)
        with suppress(BenchTimeout):  # the line fills when the main valve opens
            run.bench.wait_for(
                lambda: run.bench.supply.pressure >= at_least, within=SUPPLY_WITHIN, what="supply pressure"
            )
        pressure = run.bench.average("supply.pressure", over=0.5)
        text = f"{pressure / bar:.2f} bar"
        good = pressure >= at_least
        return ConditionResult(
            good, text if good else f"{text}; open the supply until it has {at_least / bar:g} bar"
        )

    return Precondition(f"supply pressure of at least {at_least / bar:g} bar", look, strict=False, armed=True)


def supply_for(*loads: str) -> Precondition:
    """Return a precondition: the supply pressure must exceed the spring pressure of these load cases by `HEADROOM`.

    "load" as a name means the load case of the plan's parameter.
    """

    def look(run: Run) -> ConditionResult:
        carries = max(run.specimen.load(name).fill_pressure for name in _chosen(run, loads))
        return supply(carries + HEADROOM).look(run)

    what = " and ".join("the selected load" if name == PARAMETER else name for name in loads)
    text = f"supply pressure {HEADROOM / bar:g} bar above that of {what}"
    return Precondition(text, look, strict=False, armed=True)


def on_the_bench(*loads: str) -> list[Precondition]:
    """Return the preconditions that every measurement of a spring under these load cases needs.

    "load" as a name means the load case of the plan's parameter.
    """
    return [load_cases(*loads), gas(*HALL), not_overdue(), supply_for(*loads)]


def gas(low: float, high: float) -> Precondition:
    """Return a precondition: the gas in the springs must have a temperature between ``low`` and ``high`` (K).

    At rest it has the temperature of the hall. After an earlier run, the check waits up to `COME_BACK` (s) for this
    temperature.
    """
    span = f"{low - ICE:.3g} to {high - ICE:.3g} °C"

    def look(run: Run) -> ConditionResult:
        names = [f"{side}.bellows_temperature" for side in ("left", "right")]
        if lacking := run.bench.lacks(*names):
            return ConditionResult(None, lacking)

        def within() -> bool:
            return all(low <= run.bench.readings.value(name) <= high for name in names)

        with suppress(BenchTimeout):
            run.bench.wait_for(within, within=COME_BACK, what="gas at the temperature of the hall")
        found = [run.bench.readings.value(name) for name in names]
        if silent := [name for name, one in zip(names, found, strict=True) if isnan(one)]:
            return ConditionResult(False, f"no samples arrive of {' and '.join(silent)}; check these sensors")
        text = " and ".join(f"{one - ICE:.1f} °C" for one in found)
        good = all(low <= one <= high for one in found)
        cold = any(one < low for one in found)
        right = (
            f"{COLD_FROM_BEFORE}; the hall must have {span}" if cold else f"wait until the hall has {span}"
        )
        return ConditionResult(good, text if good else f"{text}; {right}")

    return Precondition(f"gas in the springs at {span}", look, strict=False)


def calibrated(*signals: str) -> Precondition:
    """Return a precondition: the instruments of ``signals`` (default: all) must have certificates that are valid today.

    In virtual time, dates are not checked.
    """

    def look(run: Run) -> ConditionResult:
        if not run.instruments.pieces:
            return ConditionResult(
                False, "the instruments of this rig are not stated; name them in the rig file"
            )
        day = today(run)
        troubles = run.instruments.troubles(day, signals)
        fine = "all calibrations hold" if day else f"all have certificates; {NO_DAY}"
        return ConditionResult(not troubles, "; ".join(troubles) or fine)

    return Precondition("calibrated instruments", look)


def not_overdue() -> Precondition:
    """Return a precondition: no instrument is overdue for calibration.

    The result is unknown in virtual time, and if no instruments are described.
    """

    def look(run: Run) -> ConditionResult:
        pieces, day = run.instruments.pieces.values(), today(run)
        if not pieces:
            return ConditionResult(
                None, "the instruments of this rig are not stated; name them in the rig file"
            )
        if day is None:
            return ConditionResult(None, NO_DAY)
        over = [piece.trouble(day) for piece in pieces if piece.overdue(day)]
        found = "; ".join(over) + "; calibrate again" if over else "none is overdue"
        return ConditionResult(not over, found)

    return Precondition("no instrument is overdue for calibration", look, strict=False)


def load_cases(*names: str) -> Precondition:
    """Return a precondition: the specimen's file must have these load cases. "load" means the load case of the plan's
    parameter.
    """

    def look(run: Run) -> ConditionResult:
        lacking = [name for name in _chosen(run, names) if name not in run.specimen.loads]
        found = f"{run.specimen.file} has {', '.join(run.specimen.loads)}"
        return ConditionResult(
            not lacking, f"{found}; {', '.join(lacking)} would be needed" if lacking else found
        )

    what = " and ".join("the selected load" if name == PARAMETER else name for name in names)
    return Precondition(f"load case of the specimen: {what}", look)


def _chosen(run: Run, names: Iterable[str]) -> list[str]:
    return [str(run.values[name]) if name == PARAMETER else name for name in names]


def rested(at_least: float) -> Precondition:
    """Return a precondition: the specimen must have rested on this bench for ``at_least`` s since the last run or the
    connection.

    A new rig in virtual time has rested for an infinite time.
    """

    def look(run: Run) -> ConditionResult:
        rest = _time_since_last_run(run)
        text = "since it was made" if rest == inf else f"{rest:.0f} s"
        good = rest >= at_least
        return ConditionResult(good, text if good else f"{text}; wait {at_least - rest:.0f} s more")

    return Precondition(f"specimen at rest for {at_least:g} s", look)


def confirmed(text: str) -> Precondition:
    """Return a precondition: the operator must confirm ``text``, a condition that no signal shows."""

    def look(run: Run) -> ConditionResult:
        answer = run.ask(f"is this so: {text}?", (YES, NO), within=_LOOK_WITHIN)
        return ConditionResult(
            answer == YES, f"the operator answered {answer}" if answer else "the operator did not answer"
        )

    return Precondition(text, look)


def _time_since_last_run(run: Run) -> float:
    """Return the time (s) since the last run on this bench, or since the connection."""
    bench = run.bench
    if bench.last_run is None:
        return inf if isinstance(bench.clock, VirtualClock) else (run.now - bench.commander.origin) / NS
    return (run.now - bench.last_run) / NS


def today(run: Run) -> date | None:
    """Return today's date for a run in real time; None in virtual time."""
    return None if isinstance(run.bench.clock, VirtualClock) else date.fromisoformat(utc_date()[:10])
