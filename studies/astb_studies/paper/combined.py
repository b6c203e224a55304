"""The runs in addition to the sweeps: wind, track and roll at once (figures 6, 8, 10, 11), and rides (the table)."""

from collections.abc import Iterator, Mapping
from typing import Final

from astb_studies.paper.subject import LOADS
from bench_protocol.written_values import read_written

#: Changes of the plan's default parameters, for each quantity on the axis of a figure.
VARIED: Final[Mapping[str, tuple[Mapping[str, str], ...]]] = {
    "pressure": ({"pressure": "0.85"}, {}, {"pressure": "1.1"}),
    "roll": ({"roll": "-5 mrad"}, {"roll": "0 mrad"}, {}, {"roll": "20 mrad"}, {"roll": "35 mrad"}),
    "frequency": tuple({"frequency": f"{f} Hz", "amplitude": "10 mm"} for f in ("0.6", "1.2", "1.8")),
}
#: Defaults of the plan's parameters (SI).
DEFAULT: Final[Mapping[str, float]] = {"roll": 0.005, "frequency": 1.2}
#: The phase with wind, track and roll, and the checks that are read from the result.
PHASE: Final = "wind and track"
STIFFNESS: Final = "lateral stiffness K'"
DAMPING: Final = "lateral damping c"


def plan_of(load: str) -> str:
    """Return the plan of a load case."""
    return f"crosswind_and_track_{load.lower()}"


def name_of(load: str, given: Mapping[str, str]) -> str:
    """Return the name of a run: its plan, and the changed parameters."""
    return "-".join([plan_of(load), *(f"{name}={value.replace(' ', '')}" for name, value in given.items())])


def cases() -> Iterator[tuple[str, str, Mapping[str, str]]]:
    """Yield name, plan and parameters of each run, once."""
    seen = set()
    for load in LOADS:
        for given in (one for many in VARIED.values() for one in many):
            if (name := name_of(load, given)) not in seen:
                seen.add(name)
                yield name, plan_of(load), given


#: Mean winds (m/s) of the rides on the bench.
RIDE_WINDS: Final = (10.0, 25.0)
RIDE: Final = "ride"


def ride_name(load: str, wind: float) -> str:
    """Return the name of a ride."""
    return f"{RIDE}_{load.lower()}-wind={wind:g}"


def rides(quick: bool) -> Iterator[tuple[str, str, Mapping[str, str]]]:
    """Yield name, plan and parameters of each ride; an index of comfort needs five minutes, a ``quick`` one has one."""
    for load in LOADS:
        for wind in RIDE_WINDS:
            duration = "30 s" if quick else "300 s"
            given = {"load": load, "wind": f"{wind:g} m/s", "duration": duration}
            yield ride_name(load, wind), RIDE, given


def place(over: str, given: Mapping[str, str], pressure: float) -> float:
    """Return the abscissa of a run in a figure (SI): its gauge ``pressure``, its roll, or its frequency."""
    if over == "pressure":
        return pressure
    unit = {"roll": "rad", "frequency": "Hz"}[over]
    return float(read_written(over, given.get(over, f"{DEFAULT[over]} {unit}"), unit))
