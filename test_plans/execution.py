"""Execution of a plan: set-up, main part, tear-down in every case, and the record of the run."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from msgspec.structs import asdict, replace

from bench_protocol.dimensions import UNKNOWN as NO_DIMENSIONS
from bench_protocol.dimensions import Dimensions
from bench_protocol.table_signals import MEASUREMENTS
from bench_records.disk import give_room, kept
from bench_records.incident import write_incident
from bench_records.junit import write_junit
from bench_records.layout import JUNIT, RESULT, Condition, RecordError, phases_of
from bench_records.result import Outcome, SpecimenFacts, conclude
from drivers.black_box import incident_since, last_incident
from drivers.errors import BenchError
from test_plans.air_left import KEEP_AWAY, air_at_risk, air_left
from test_plans.analysis import NotMeasured
from test_plans.asking import Aborted
from test_plans.description import clocks
from test_plans.driven import drive_curves
from test_plans.instruments import UNKNOWN, Instruments
from test_plans.interruptions import Interruptions
from test_plans.loads import SpecimenError
from test_plans.operator import NoOperator, Operator
from test_plans.parameters import ParameterRefused
from test_plans.plan import Plan
from test_plans.preconditions import Precondition, today
from test_plans.proofreading import mistakes
from test_plans.punctuality import lateness, timing
from test_plans.recording import Recording, begin_recording, keep_settings
from test_plans.run import NoTwin, NullWatcher, Run, SafeWatcher, TwinState, Watcher
from test_plans.specimen import Specimen, ordinary
from test_plans.steps.carrying import ARM_WITHIN
from test_plans.suspension import HeldTooLong, Suspension

if TYPE_CHECKING:
    from bench_protocol.black_box import Incident
    from bench_records.result import Result
    from drivers.bench import Bench

#: Text for the origin of a fault.
WHOSE: Final = {"rig": "the rig", "link": "the link to the rig", "plan": "the plan", "record": "the record"}
#: Begin of the reason of a run that is blocked because the disk does not keep the record.
BY_THE_RECORD: Final = f"{WHOSE['record']}: "
#: Begin of a warning that a run did not leave the bench in the specified state.
IN_TEAR_DOWN: Final = "in tear-down: "
_OPERATOR: Final = "the operator"


class NotReady(Exception):
    """Raised if a precondition of a plan is not met."""


def execute(
    plan: Plan,
    bench: Bench,
    directory: Path | str,
    *,
    meta: Mapping[str, Any] | None = None,
    rig: str = "",
    seed: int | None = None,
    watcher: Watcher | None = None,
    specimen: Specimen | None = None,
    operator: Operator | None = None,
    suspension: Suspension | None = None,
    twin: TwinState | None = None,
) -> Result:
    """Run ``plan`` on a connected ``bench`` and write record, ``result.json`` and ``junit.xml`` to ``directory``.

    Without a ``specimen`` the default one is used. Without an ``operator`` a simulated rig performs the manual actions
    that it offers. Computed values have an uncertainty if the instruments of the bench are known.

    The verdict is *fail* if the product exceeded a limit, and *blocked* if rig, link, plan or operator prevented the
    judgement. Tear-down runs in every case; the reason lists its errors after the earlier ones. KeyboardInterrupt is
    raised again after all files are written, with a text on the air in the springs. ``bench_records.report`` makes the
    report from the directory.
    """
    spring, instruments = specimen or ordinary(), bench.instruments or UNKNOWN
    dimensions = bench.dimensions or NO_DIMENSIONS
    plan = plan.on(spring)
    facts = _facts(plan, spring, instruments, dimensions) | _clocks(bench) | dict(meta or {})
    recording = begin_recording(bench, directory, facts)
    hand = operator or bench.hand or NoOperator()
    run = Run(
        bench,
        recording,
        SafeWatcher(watcher or NullWatcher()),
        plan.lasts,
        spring,
        hand,
        instruments,
        dimensions,
        suspension or Suspension(),
        plan.values,
        plan.judges,
        twin=twin or NoTwin(),
    )
    content = {name: str(facts.get(name, "")) for name in ("operator", "ambient")}
    rest = {"began": facts.get("date", ""), "rig": rig, "seed": seed, **content}
    with Interruptions() as stops:
        result, left = _carried_out(plan, run, recording, directory, stops, rest)
    if left is not None:
        raise KeyboardInterrupt(left)
    return result


def _carried_out(
    plan: Plan,
    run: Run,
    recording: Recording,
    directory: Path | str,
    stops: Interruptions,
    facts: Mapping[str, Any],
) -> tuple[Result, str | None]:
    """Execute ``plan`` and write the result. Return it, and the text on the air in the springs if the operator stopped
    the run.
    """
    bench = run.bench
    before, known = lateness(bench), last_incident(bench)
    with _recorded(run, recording):
        first, last, interrupted = _perform(run, plan, stops)
        left = air_left(bench) if interrupted else air_at_risk(bench)
        strangers = bench.strangers()
        for note in filter(None, (left, strangers)):
            run.say(note)
        punctuality = timing(before, lateness(bench), run.disturbed)
        incident = incident_since(bench, known)
    run.progress(1.0)
    bench.last_run = run.now

    if lost := recording.failure or str(bench.receiver.failure or ""):
        first = first or f"{WHOSE['record']}: {lost}"
        if lost not in first:
            run.warnings.append(f"{WHOSE['record']}: {lost}")
    reason = _reason(run, first, last, left, strangers)
    if last and not reason:  # the verdict stays *fail*; the warning is for the next user
        run.warnings.append("; ".join(filter(None, (f"{IN_TEAR_DOWN}{last}", left))))
    result = _concluded(run, plan, reason, timing=punctuality, **facts)
    return _written(result, incident, Path(directory)), left if interrupted else None


def blocked_by_the_link(result: Result) -> bool:
    """Return whether a run was blocked because of the link to the rig."""
    parts = result.reason.partition("; then ")[0].split("; ")
    return any(part.startswith(f"{WHOSE['link']}: ") for part in parts)


def _facts(plan: Plan, spring: Specimen, instruments: Instruments, dimensions: Dimensions) -> dict[str, Any]:
    """Return the entries of a record that are known before the run."""
    content = {"instruments": instruments.facts, "dimensions": dimensions.facts}
    return {
        "plan": plan.name,
        "title": plan.title,
        "instruction": plan.instruction,
        "set": plan.written,
        "specimen": spring.facts,
        **{name: facts for name, facts in content.items() if facts},
    }


def _clocks(bench: Bench) -> dict[str, Any]:
    """Return the entries of a record on the clocks of its time stamps, if known."""
    stamps = clocks(bench)
    return {"time_stamps": stamps} if stamps else {}


def _concluded(run: Run, plan: Plan, reason: str, **rest: Any) -> Result:
    """Return the result of a run that has ended. ``reason`` states why the product could not be judged."""
    return conclude(
        plan.name,
        plan.title,
        plan.instruction,
        run.checks,
        reason=reason,
        curves=[*run.curves, *drive_curves(run.driven)],
        phases=phases_of(run.phases, run.start, run.now),
        parameters=plan.written,
        specimen=SpecimenFacts(**run.specimen.facts),
        preconditions=run.preconditions,
        warnings=run.warnings,
        **rest,
    )


def _perform(run: Run, plan: Plan, stops: Interruptions) -> tuple[str, str, bool]:
    """Run the parts of a plan. Return the error before tear-down, the error in tear-down, and whether the operator
    stopped the run.

    Nothing is moved if the rig lacks a need of the plan, or if the code of the plan has an error.
    """
    if lacking := run.lacks(*plan.needs):
        trouble = f"{WHOSE['rig']}: {lacking}; {plan.name} cannot run without it"
        run.keep("error", trouble)
        return trouble, "", False
    if wrong := mistakes(plan, run):
        trouble = f"{WHOSE['plan']}: {'; '.join(wrong)}"
        run.keep("error", trouble)
        return trouble, "", False
    run.warnings += run.instruments.troubles(today(run))
    for warning in run.warnings:
        run.say(warning)
    attempt = partial(_attempt, run, stops, plan)
    unmet, interrupted = attempt("preconditions", partial(_require, plan)) if plan.requires else ("", False)
    if unmet:
        return unmet, "", interrupted
    first, interrupted = attempt("set-up", plan.bound(plan.setup))
    if not first:
        first, interrupted = attempt("main", plan.bound(plan.main))
    run.bench.receiver.needed = False  # the bench must come to rest even without a record
    last, again = attempt("tear-down", plan.bound(plan.teardown))
    return first, last, interrupted or again


def _require(plan: Plan, run: Run) -> None:
    """Check the preconditions of ``plan``. Raises NotReady, with the remedy, if one is not met.

    The bench is armed for a moment if a precondition can be checked only then.
    """
    unmet = [text for one in plan.requires if not one.armed for text in _unmet(run, one)]
    if not unmet and (armed := [one for one in plan.requires if one.armed]):
        try:
            run.bench.arm(within=ARM_WITHIN)
            unmet = [text for one in armed for text in _unmet(run, one)]
        except BaseException:
            with suppress(BenchError):  # the first error is reported
                run.bench.disarm()
            raise
        run.bench.disarm()
    if unmet:
        raise NotReady("; ".join(unmet))


def _unmet(run: Run, one: Precondition) -> list[str]:
    """Check a precondition, and record the state found. Return a list with a text if the plan must not begin; otherwise
    it is empty.
    """
    found = one.look(run)
    condition = Condition(one.text, found.met, found.found)
    run.preconditions.append(condition)
    run.keep("precondition", f"{one.text}: {found.found}", met=found.met, whole=asdict(condition))
    blocks = found.met is False or (found.met is None and one.strict)
    return [f"{one.text} ({found.found})"] if blocks else []


def _written(result: Result, incident: Incident | None, directory: Path) -> Result:
    """Write the result, and the ``incident`` of the black box if any, to ``directory``; return the result.

    If a file cannot be written, the run is *blocked*, and the other files contain this reason.
    """
    give_room(directory)
    if not (lost := _refused(result, incident, directory)):
        return result
    reason = "; then ".join(filter(None, (result.reason, f"{BY_THE_RECORD}{lost}")))
    result = replace(result, verdict=Outcome.BLOCKED, reason=reason)
    _refused(result, None, directory)
    return result


def _refused(result: Result, incident: Incident | None, directory: Path) -> str:
    """Write all files of a run except its record. Return the errors of files that cannot be written; "" if there are
    none.
    """
    lost: list[str] = []

    def attempt(name: str, write: Callable[[], object]) -> None:
        try:
            with kept(directory / name):
                write()
        except RecordError as error:
            lost.append(str(error))

    attempt(RESULT, lambda: result.write(directory))
    attempt(JUNIT, lambda: write_junit(result, directory))
    if incident is not None:
        channels = {name: incident.values(name) for name in incident.channels}
        attempt("", lambda: write_incident(directory, incident.story, incident.times, channels))
    return "; ".join(lost)


@contextmanager
def _recorded(run: Run, recording: Recording) -> Iterator[None]:
    """During the block, record all received data and all changes of settings. The present settings are recorded
    first.
    """
    bench = run.bench
    bench.receiver.sink, bench.receiver.failure, bench.receiver.needed = recording.take, None, True
    bench.settings.applied = lambda values: keep_settings(run, values)
    try:
        if other := bench.wiring.capabilities.notes.get("identity"):
            run.say(other)
        with suppress(BenchError):  # set-up will report a lost rig
            keep_settings(run, bench.settings.in_force())
        yield
    finally:
        bench.receiver.sink = None
        bench.settings.applied = lambda values: None
        recording.close()


def _reason(run: Run, first: str, last: str, *more: str) -> str:
    """Return the reason why the product could not be judged; "" if it could.

    ``first`` is the error before tear-down, ``last`` the error in tear-down. ``more`` is additional information: the
    air in the springs, and other clients that tried to command the bench. Instructions for a person come first.
    """
    if not first and conclude("", "", "", run.checks).verdict is Outcome.FAIL:
        return ""  # it was judged and failed; later errors of the bench are among the events
    reason = "; then ".join(trouble for trouble in (first, last and f"{IN_TEAR_DOWN}{last}") if trouble)
    if not reason:
        return ""
    new = [one for one in more if one and one not in reason]
    return "; ".join(sorted((reason, *new), key=lambda one: not one.startswith(KEEP_AWAY)))


def _attempt(
    run: Run, stops: Interruptions, plan: Plan, name: str, part: Callable[[Run], None]
) -> tuple[str, bool]:
    """Run one part of a plan. Return the error with its origin ("" without one), and whether the operator stopped the
    run.
    """
    interrupted, stopped = False, f"stopped by {_OPERATOR}"
    run.to_come = {"tear-down": (), "main": (plan.teardown,)}.get(name, (plan.main, plan.teardown))
    try:
        with stops.interruptible(), run.phase(name):
            part(run)
        return "", False
    except BenchError as error:
        hidden = _hidden(error) if name == "tear-down" else ""
        place = f" ({_error_line(error, plan)})" if error.fault == "plan" else ""
        trouble = f"{hidden}{WHOSE[error.fault]}: {error}{place}"
    except NotMeasured as error:
        trouble = f"the measurement: {error}{_silent(run.bench)}"
    except ParameterRefused as error:
        trouble = f"the parameters: {error}"
    except SpecimenError as error:
        trouble = f"the specimen's file: {error}"
    except NotReady as error:
        trouble = f"not ready: {error}"
    except HeldTooLong as error:
        trouble = f"{stopped}: {error}"
    except Aborted as stop:
        trouble = f"{stopped}: {stop}"
    except KeyboardInterrupt:
        trouble, interrupted = f"stopped by {run.suspension.stopped_by or _OPERATOR}", True
    except (Exception, SystemExit) as error:  # an exit of the program must not skip the tear-down
        trouble = f"the plan: {type(error).__name__} at {_error_line(error, plan)}: {error}"
    try:
        run.keep("error", f"{name}: {trouble}")
        run.watcher.say(f"{name}: {trouble}")
    except KeyboardInterrupt:  # raised by a program that stops its plan without a signal
        interrupted = True
    return trouble, interrupted


def _hidden(error: BaseException) -> str:
    """Return the earlier errors of a tear-down as text. There may be several, because each step runs even if the
    previous one failed.
    """
    texts: list[str] = []
    before = error.__context__
    while before is not None:
        if isinstance(before, BenchError) and str(before) not in "; ".join([str(error), *texts]):
            texts.insert(0, f"{WHOSE[before.fault]}: {before}; ")
        before = before.__context__
    return "".join(texts)


def _silent(bench: Bench) -> str:
    """Return a text that names the measurements without a value. An error about samples does not name its signal, so
    all are checked.
    """
    silent = [
        signal.name
        for signal in MEASUREMENTS
        if not bench.lacks(signal.name) and isnan(bench.readings.value_or_nan(signal.name))
    ]
    return (
        f"; no samples arrive of {', '.join(silent)}; check these sensors" if silent else "; repeat the run"
    )


def _error_line(error: BaseException, plan: Plan) -> str:
    """Return file and line of an error: the innermost line in the file of ``plan``, otherwise in this package."""
    frames = traceback.extract_tb(error.__traceback__)
    own = getattr(sys.modules.get(plan.main.__module__), "__file__", None)
    machinery = [Path(__file__).with_name(f"{name}.py") for name in ("execution", "plan", "run")]
    outside = [frame for frame in frames if Path(frame.filename) not in machinery]
    plans = [frame for frame in outside if frame.filename == own] or [
        frame for frame in outside if Path(frame.filename).parent == Path(__file__).parent
    ]
    frame = (plans or outside or list(frames))[-1 if plans else 0]
    return f"{Path(frame.filename).name}:{frame.lineno}"
