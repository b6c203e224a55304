"""Times until the bench holds, and until it is safe, after processes are killed and connections are cut."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from astb.campaigns.workers import executor
from astb_studies.benchmarks.cuts import CUTS, REAL_CUTS, Cut
from astb_studies.benchmarks.measure import BenchmarkRow, Effort, Section, Spread
from astb_studies.benchmarks.real_cuts import RealCuts
from astb_studies.benchmarks.virtual_cuts import virtual_cuts
from astb_studies.places import DOCS
from bench_protocol.rates import TICK
from bench_protocol.units import ms

#: Of each kind: a thousand in virtual time in all.
VIRTUAL, QUICK_VIRTUAL = 112, 8
REAL, QUICK_REAL = 20, 1
#: Delay between an event and the frame that reports it: without an emergency, a state message is sent every 20 ms. On
#: sockets, the transport adds its delay.
TELLING: Final = 20 * ms
TRANSPORT: Final = 10 * ms
PICTURE: Final = DOCS / "gallery" / "time-to-safe.svg"

#: Time to hold and time to safe (s), one row a cut.
Times = NDArray[np.float64]


def run(effort: Effort) -> Section:
    """Cut everything in virtual and in real time; a run that is not quick draws the histograms too."""
    seeds = range(4)
    each = (QUICK_VIRTUAL if effort.quick else VIRTUAL) // len(seeds)
    virtual: dict[Cut, Times] = {}
    with executor() as pool:
        for kind in CUTS:
            virtual[kind] = np.concatenate(list(pool.map(partial(virtual_cuts, kind, each), seeds)))
    real: dict[Cut, list[tuple[float, float]]] = {kind: [] for kind in REAL_CUTS}
    with RealCuts() as rig:
        for _ in range(QUICK_REAL if effort.quick else REAL):
            for kind in REAL_CUTS:
                real[kind].append(rig.cut(kind))
    measured = {kind: np.array(times) for kind, times in real.items()}
    if not effort.quick:
        draw(virtual, measured)
    return Section(
        "Time to safe", [*rows(virtual, "virtual", 0.0), *rows(measured, "real", TRANSPORT)], NOTES
    )


def rows(measured: Mapping[Cut, Times], time: str, transport: float) -> Sequence[BenchmarkRow]:
    """Return two rows for each kind of cut: until it holds, and until it is safe."""
    found = []
    for kind, times in measured.items():
        aims = (
            kind.hold_within + TICK + max(transport, TELLING * (kind.name == "power lost")),
            kind.safe_within,
        )
        for what, series, aim in zip(("holds", "safe"), times.T, aims, strict=True):
            worst = float(series.max())
            found.append(
                BenchmarkRow(
                    f"{kind.name}, {time}: {what}, the worst of {series.size}: {worst:.3g} s; median",
                    "s",
                    Spread.of(series.tolist()),
                    aim=f"at most {aim:.3g} s",
                    met=bool(worst <= aim),
                )
            )
    return found


def draw(virtual: Mapping[Cut, Times], real: Mapping[Cut, Times]) -> None:
    """Draw histograms of the virtual times, with the real ones as marks and the limits as lines."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "time to safe"}):
        figure = Figure(figsize=(9, 1.5 * len(virtual)), layout="constrained")
        axes = figure.subplots(len(virtual), 2, sharex="col")
        for row, (kind, times) in zip(axes, virtual.items(), strict=True):
            limits, bins = (
                (kind.hold_within, kind.safe_within),
                (np.linspace(0, 1.1, 111), np.linspace(0, 16, 65)),
            )
            for column, (axis, limit) in enumerate(zip(row, limits, strict=True)):
                axis.hist(times[:, column], bins[column], color="#4878a8", histtype="stepfilled")
                axis.axvline(limit, color="#b03030", linewidth=1)
                if kind in real:
                    axis.plot(
                        real[kind][:, column], np.zeros(len(real[kind])), "|", color="black", clip_on=False
                    )
                axis.set_ylim(bottom=0)
            row[0].set_title(kind.name, loc="left", fontsize=9)
        axes[-1, 0].set_xlabel("until it holds, s")
        axes[-1, 1].set_xlabel("until it is safe, s")
        figure.savefig(PICTURE, metadata={"Date": None})


NOTES: Final = (
    "A plan arms the bench and holds the bolster against springs under pressure (in virtual time 0.5 to 5.6 bar, 40 mm "
    "below to 60 mm above design height, half of them moving; on sockets 0.6 bar). The connection is lost at a random "
    "instant. *Holds* is the time until another CAN node receives the state, *safe* the time until every pressure is "
    "below 0.22 bar and the actuators are without force. The limits are those of the "
    "[table of states](../../docs/reference/states.md), plus one tick and the period of the state message: 20 ms, on "
    "sockets 10 ms. If Modbus alone fails without a reset, the watchdog of 1 s detects it, and the plan then disables "
    "the drives over CAN.",
    "![Histograms of both times: bars virtual, marks on sockets, lines the aims](../../docs/gallery/time-to-safe.svg)",
)
