"""Check of a rig without commands: the source, rate, age and value of every signal."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec.structs import replace

from astb.acceptance.checking.consequences import checks_without, missing
from astb.acceptance.checking.report import CheckReport, ConnectionLine, Plausibility, SignalLine
from astb.acceptance.checking.rest import doubts
from astb.listening import Listening
from bench_protocol.dimensions import NAMES, Dimensions
from bench_protocol.signals import Kind, Signal
from bench_protocol.units import NS, s
from bench_protocol.words import STATES
from drivers.errors import BenchError
from drivers.receiver import Capture
from drivers.wiring.sequences import READ
from test_plans.discovery import plans

#: Time to listen to a rig, and the longest silence before the first message (s).
LISTEN: Final = 2 * s
WITHIN: Final = 3 * s
#: Signals that only our own rigs send; other rigs may lack them.
_OURS: Final = ("control.", "lease.", "emergency.", "action.", "interlock.", "rig.")
_EXPECTED: Final = (
    "rig.state",
    "rig.reason",
    "interlock.estop",
    "rig.nominal_preload",
    "rig.orifice_diameter",
)


def examine(listening: Listening, rig: str = "", dimensions: Dimensions | None = None) -> CheckReport:
    """Receive signals for 2 s, and return the findings about ``rig``. Nothing is written, and nothing moves.

    If ``dimensions`` is given, each dimension that plans need and that it does not state is reported as missing.
    """
    return _Examination(listening).report(rig, dimensions)


class _Examination:
    """One examination of a rig."""

    def __init__(self, listening: Listening) -> None:
        self._receiver, self.clock = listening.receiver, listening.clock
        self.wiring, self.table = listening.wiring, listening.table

    def report(self, rig: str, dimensions: Dimensions | None) -> CheckReport:
        wiring, stated = self.wiring, NAMES if dimensions is None else dimensions.known
        played = wiring.played
        reported = [one for one in self.table.of_kind(*READ) if one.name not in (*wiring.absent, *played)]
        coming = [one for one in reported if wiring.freshness[self.table.index[one.name]] > 0]
        with Capture(self._receiver, [one.name for one in coming]) as capture:
            self.clock.sleep_until(self.clock.now() + round(LISTEN * NS))
            now = self.clock.now()
        lines = {one.name: self._signal_line(one, capture, now) for one in coming}
        asked = [one for one in reported if one.name not in lines] + [
            one for one in self.table.of_kind(Kind.SETTING) if one.name not in (*wiring.absent, *played)
        ]
        lines |= {one.name: self._line_on_request(one) for one in asked}
        state = self._state(lines)
        lines = self._mark_doubtful(lines, at_rest=state in (*wiring.sequences.at_rest, "unknown"))
        for one in self.table.signals:
            if one.name in wiring.absent and (
                one.name in _EXPECTED or not one.name.startswith(_OURS) or self._reasoned(one.name)
            ):
                lines[one.name] = SignalLine(
                    name=one.name, verdict=Plausibility.ABSENT, remark=wiring.absent[one.name]
                )
        for one in self.table.of_kind(Kind.SETPOINT):
            if one.name not in wiring.absent and not one.name.startswith(_OURS):
                lines[one.name] = SignalLine(
                    name=one.name,
                    verdict=Plausibility.UNTOLD,
                    source=self.wiring.source(one.name),
                    remark="ASTB only writes it",
                )
        return CheckReport(
            rig=rig or wiring.rig,
            identity=wiring.identity(),
            state=state,
            capabilities=self._capabilities(),
            signals=sorted(lines.values(), key=lambda line: self.table.index[line.name]),
            connections=self._connections(),
            remembered=[
                one.name for one in self.table.of_kind(Kind.SETTING) if one.name in wiring.remembered
            ],
            plans=len(plans()),
            missing=missing([*wiring.absent, *(name for name in NAMES if name not in stated)]),
            checks=checks_without(wiring.absent),
        )

    # -- signals -------------------------------------------------------------------------------------------------

    def _signal_line(self, signal: Signal, capture: Capture, now: int) -> SignalLine:
        times, values = capture.times(signal.name), capture.values(signal.name)
        good = values[~np.isnan(values)]
        source = self.wiring.source(signal.name)
        if not times.size:
            last, time = self._receiver.latest(self.table.index[signal.name])
            limit = int(self.wiring.freshness[self.table.index[signal.name]])
            if time >= 0 and now - time <= limit:  # sent on events only, or seldom
                return self._line(signal, last, source, age=(now - time) / NS)
            return SignalLine(
                name=signal.name,
                verdict=Plausibility.UNTOLD
                if signal.name.startswith("emergency.")
                else Plausibility.DOUBTFUL,
                source=source,
                rate=0.0,
                remark=f"no sample was received in {LISTEN:g} s",
            )
        mean = math.nan if not good.size else float(good[-1] if signal.choices else good.mean())
        age = (now - capture.start) / NS - float(times[-1])
        return self._line(signal, mean, source, rate=times.size / LISTEN, age=age)

    def _line_on_request(self, signal: Signal) -> SignalLine:
        """Read a signal that the rig sends only on request, and return the line of the report about it."""
        source = self.wiring.source(signal.name)
        try:
            value = self.wiring.read([signal.name])[signal.name]
        except BenchError as error:
            return SignalLine(
                name=signal.name, verdict=Plausibility.DOUBTFUL, source=source, remark=str(error)
            )
        if math.isnan(value) and signal.name in self.wiring.remembered:
            return SignalLine(
                name=signal.name,
                verdict=Plausibility.UNTOLD,
                source=source,
                remark="no point reads this signal back; the last written value is used",
            )
        return self._line(signal, value, source)

    def _line(
        self,
        signal: Signal,
        value: float,
        source: str,
        *,
        rate: float | None = None,
        age: float | None = None,
    ) -> SignalLine:
        known = not math.isnan(value)
        idle = not known and signal.name.startswith("car.")
        return SignalLine(
            name=signal.name,
            verdict=Plausibility.UNTOLD if idle else Plausibility.FINE,
            source=source,
            remark="no plan simulates a car now" if idle else "",
            shown=signal.show(value) if known else "",
            value=value if known else None,
            rate=rate,
            age=age,
        )

    def _mark_doubtful(self, lines: dict[str, SignalLine], *, at_rest: bool) -> dict[str, SignalLine]:
        means = {
            name: math.nan if line.value is None else line.value
            for name, line in lines.items()
            if line.verdict is Plausibility.FINE
        }
        found = doubts(means, {name: self.table[name] for name in means}, at_rest=at_rest)
        return lines | {
            name: replace(lines[name], verdict=Plausibility.DOUBTFUL, remark=doubt)
            for name, doubt in found.items()
        }

    def _reasoned(self, name: str) -> bool:
        return self.wiring.absent[name] != "the wiring does not mention it"

    def _state(self, lines: dict[str, SignalLine]) -> str:
        line = lines.get("rig.state")
        return STATES[round(line.value)] if line is not None and line.value is not None else "unknown"

    def _connections(self) -> list[ConnectionLine]:
        return [
            ConnectionLine(
                name=name,
                verdict=Plausibility.DOUBTFUL if one.doubtful else Plausibility.FINE,
                remark=one.text,
            )
            for name, remarks in self.wiring.remarks().items()
            for one in remarks
        ]

    def _capabilities(self) -> list[str]:
        can = self.wiring.capabilities
        return [
            "function generator" if can.generator else "no function generator: ASTB sends the waves",
            "one commander at a time (lease)"
            if can.lease
            else "no lease: two commanders cannot detect each other",
            "watchdog of the settings" if can.watchdog else "no watchdog of the settings' connection",
            "signal map reported" if can.identity else "signal map not reported",
            *(f"{name}: {text}" for name, text in can.notes.items()),
        ]
