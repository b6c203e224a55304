"""`astb copy specimen`: limits of a specimen with other loads or another drawing, derived from its model.

Plans run on the simulated bench with these springs. Each limit gets a unique band there, which identifies the check
that uses it. The measured value becomes the expected one; tolerances are those of the base file.
"""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any, Final, cast

from astb.rig_in_memory import RigInMemory
from bench_protocol.entries import Span
from bench_protocol.input_limits import read_toml
from bench_protocol.named_files import place_of
from bench_protocol.units import UNITS
from bench_protocol.written_values import fitting_unit, read_written
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.loads import Band, Limits, SpecimenError
from test_plans.specimen import DRAWING, LOAD, MODEL, ORDINARY, OVER, PACKAGE, read_specimen

if TYPE_CHECKING:
    from test_plans.specimen import Specimen

#: A limit that no value breaks; the number of the limit is added to it.
_WIDE: Final = 1e12
#: The plan that judges a load case as a whole.
_PLANS: Final = {"AW0": "aw0", "AW3": "aw3"}
_DIGITS: Final = 4
#: Key of a value: load case, limit and place on its curve (SI; None without a curve).
Place = tuple[str, str, float | None]
Found = dict[Place, list[tuple[float, str]]]
_DERIVED: Final = "derived"
_GIVEN: Final = "given to `astb copy specimen`"


@dataclass(frozen=True, slots=True)
class Asked:
    """The changes to the specimen ``base``: preloads (N) by load case, and values of the drawing (SI).

    ``plans`` run in addition to the plan of each load case.
    """

    base: str = ORDINARY
    preloads: Mapping[str, float] = field(default_factory=dict)
    drawing: Mapping[str, float] = field(default_factory=dict)
    plans: Sequence[str] = ()


def new_specimen(
    target: Path,
    base: str,
    preloads: Sequence[str],
    drawing: Sequence[str],
    beside: Sequence[str],
    say: Callable[[str], None],
) -> None:
    """Write a specimen with preloads and values of the drawing given as text: ``AW0=45 kN``.

    Raises ValueError with name, value and correct form.
    """

    def read(option: str, texts: Sequence[str], spans: Mapping[str, Span] | None) -> dict[str, float]:
        found = {}
        for text in texts:
            name, _, value = text.partition("=")
            if spans is not None and name not in spans:
                raise SpecimenError(
                    f"{option} {name} is not a property of a drawing; the properties are {', '.join(spans)}"
                )
            span = spans[name] if spans else LOAD["preload"]
            found[name] = read_written(f"{option} {name}", value, span.si)
            if not span.low <= found[name] <= span.high:
                raise SpecimenError(
                    f"{option} {text} is not plausible; use {span.low:g} to {span.high:g} {span.si}"
                )
        return found

    asked = Asked(base, read("--preload", preloads, None), read("--set", drawing, DRAWING), beside)
    if left_out := derive(asked, target, say):
        say(f"limits left out, because no plan measured them (add one with --plan): {', '.join(left_out)}")


def derive(asked: Asked, target: Path, say: Callable[[str], None]) -> list[str]:
    """Write a specimen with derived limits to a file; return the limits that no plan measured, which are left out.
    Raises SpecimenError for names that are not in the base, for contradictions, and for a plan that does not run with
    the new specimen.
    """
    content = read_toml(place_of(PACKAGE, asked.base))
    base = read_specimen(asked.base)
    for name in asked.preloads:
        base.load(name)
    changed = list(base.loads) if asked.drawing else list(asked.preloads)
    spring = _with_loads(replace(base, **cast("dict[str, Any]", asked.drawing)), asked.preloads)
    model = base.model or ORDINARY
    found: Found = {}
    names = [*(_PLANS[name] for name in changed if name in _PLANS), *asked.plans]
    for name in dict.fromkeys(names):
        say(f"running {name} on the simulated bench")
        for place, measured in _measured(name, spring, model, asked.drawing):
            found.setdefault(place, []).append(measured)
    for key, value in asked.drawing.items():
        content["properties"][key] = _value(value, DRAWING[key].si, "assumed", _GIVEN)
    left_out: list[str] = []
    for case in changed:
        entries, load_then = content["load_case"][case], base.loads[case]
        now = spring.loads[case]
        if case in asked.preloads:
            entries["preload"] = _value(now.preload, "N", "assumed", _GIVEN)
        entries["fill_pressure"] = _value(now.fill_pressure, "Pa", _DERIVED, "preload over effective area")
        entries["roll_load"] = _value(now.roll_load, "N", _DERIVED, "in proportion to the preload")
        more = now.preload - load_then.preload
        source = f"model {model}; width as in {base.file}"
        limits, missing = _limits(entries.pop("limits", {}), case, found, more, source)
        entries["limits"] = limits
        left_out += [f"load_case.{case}.limits.{name}" for name in missing]
    if asked.drawing:
        content.pop(MODEL, None)  # of another spring
    head = (
        f"# Derived by `astb copy specimen` from {base.file}: limits marked as derived are what the simulated bench",
        "# measures with these springs. Put in type, serial number and drawing, and what a data sheet states.",
        *(["# Left out, for no plan that was run measures them:"] if left_out else []),
        *(f"#   {name}" for name in left_out),
    )
    target.write_text("\n".join([*head, "", *_toml(content)]) + "\n", encoding="utf-8")
    try:
        read_specimen(target)
    except SpecimenError:  # the requested changes contradict each other
        target.unlink()
        raise
    return left_out


def _with_loads(spring: "Specimen", preloads: Mapping[str, float]) -> "Specimen":
    loads = {}
    for name, one in spring.loads.items():
        preload = preloads.get(name, one.preload)
        loads[name] = replace(
            one,
            preload=preload,
            fill_pressure=spring.pressure_for(preload),
            roll_load=one.roll_load * preload / one.preload,
        )
    return replace(spring, loads=loads)


def _measured(
    name: str, spring: "Specimen", model: str, drawing: Mapping[str, float]
) -> list[tuple[Place, tuple[float, str]]]:
    """Return the value (SI) of each limit that a plan uses, with the name of its check."""
    places: list[Place] = []

    def band(*place: Any) -> Band:
        places.append(place)
        return Band(-_WIDE - len(places), _WIDE + len(places))

    def marked(case: str, limits: Limits) -> Limits:
        return replace(
            limits,
            bands={limit: band(case, limit, None) for limit in limits.bands},
            curves={
                limit: {at: band(case, limit, at) for at in curve} for limit, curve in limits.curves.items()
            },
        )

    loads = {case: replace(one, limits=marked(case, one.limits)) for case, one in spring.loads.items()}
    known = plans()
    if name not in known:
        raise SpecimenError(f"there is no plan {name}; the plans are {', '.join(known)}")
    rig = RigInMemory(Rig(load(model).with_values(**drawing), seed=0))
    with tempfile.TemporaryDirectory() as folder, rig.bench(seed=0) as bench:
        result = execute(
            known[name], bench, folder, rig="virtual", seed=0, specimen=replace(spring, loads=loads)
        )
    if result.reason:
        raise SpecimenError(f"plan {name} cannot run with these springs: {result.reason}")
    found = []
    for check in result.checks:
        number = round((check.high or 0.0) - _WIDE)
        marks = check.value is not None and check.high is not None and check.low == -check.high
        if marks and 1 <= number <= len(places):
            found.append((places[number - 1], (check.number, check.name)))
    return found


def _limits(
    entries: Mapping[str, Any], case: str, found: Found, more: float, source: str
) -> tuple[dict[str, Any], list[str]]:
    """Return the new limits of a load case, and the names of those that no plan measures.

    ``more`` is the increase of the preload (N).
    """
    kept: dict[str, Any] = {}
    missing: list[str] = []
    for name, entry in entries.items():
        if all(isinstance(one, dict) for one in entry.values()):  # the table of a plan
            group: dict[str, Any] = {}
            for inner, one in entry.items():
                now = _limit(f"{name}.{inner}", one, case, found, more, source)
                group |= {inner: now} if now else {}
                missing += [] if now else [f"{name}.{inner}"]
            kept |= {name: group} if group else {}
            continue
        now = _limit(name, entry, case, found, more, source)
        kept |= {name: now} if now else {}
        missing += [] if now else [name]
    return kept, missing


def _limit(
    name: str, entry: Mapping[str, Any], case: str, found: Found, more: float, source: str
) -> dict[str, Any] | None:
    """Return one new limit: around the new value, with the old relative width; None without a new value.

    A limit with one end does not change. The limits ``carried`` are moved by ``more`` (N).
    """
    factor = UNITS[entry["unit"]].factor
    if name == "carried":
        ends = {end: _rounded(entry[end] + more / factor, 6) for end in ("low", "high") if end in entry}
        return {
            **entry,
            **ends,
            "provenance": _DERIVED,
            "source": f"moved with the preload; {entry['source']}",
        }
    over = next((one for one in OVER if one in entry), None)
    if "expected" not in entry and not {"low", "high"} <= set(entry):
        return dict(entry)  # one-sided: it holds for other loads too
    places = [None] if over is None else [at * OVER[over] for at in entry[over]]
    values = [found.get((case, name, place), []) for place in places]
    if not all(values):
        return None
    middles = [fmean(value for value, _ in one) / factor for one in values]
    checks = ", ".join(dict.fromkeys(check for one in values for _, check in one))
    origin = {"provenance": _DERIVED, "source": f"{checks}: {source}"}
    if "expected" in entry:
        expected = [_rounded(one, _DIGITS) for one in middles]
        return {**entry, "expected": expected if over else expected[0], **origin}
    half = 0.5 * (entry["high"] - entry["low"]) / (0.5 * (entry["high"] + entry["low"]))
    ends = {
        end: _rounded(middles[0] * (1.0 + sign * half), _DIGITS)
        for end, sign in (("low", -1.0), ("high", 1.0))
    }
    return {**entry, **ends, **origin}


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def _value(value: float, si: str, provenance: str, source: str) -> dict[str, Any]:
    unit = fitting_unit(value, si)
    return {
        "value": _rounded(value / UNITS[unit].factor, 6),
        "unit": unit,
        "provenance": provenance,
        "source": source,
    }


def _toml(content: Mapping[str, Any], way: tuple[str, ...] = ()) -> list[str]:
    """Return the lines of nested tables, with each entry (a table with a unit) on one line."""
    lines, tables = [], {}
    for key, value in content.items():
        if isinstance(value, dict) and "unit" not in value:
            tables[key] = value
        elif isinstance(value, dict):
            inside = ", ".join(f"{name} = {_written(one)}" for name, one in value.items())
            lines.append(f"{key} = {{ {inside} }}")
        else:
            lines.append(f"{key} = {_written(value)}")
    head = ["", f"[{'.'.join(way)}]"] if way and lines else []
    return [*head, *lines, *(line for key, table in tables.items() for line in _toml(table, (*way, key)))]


def _written(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
