"""The functions of ``import astb``: open a bench, run plans, and diagnose records."""

import atexit
import logging
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from msgspec.structs import replace

from astb.operators import with_hand
from astb.rig_file import RigFile, RigFileError, find_rig
from astb.run import describe, new_directory, undisturbed
from astb.session import open_session
from bench_records.checksums import write_sums
from bench_records.report import write_report
from bench_sim.parameters import load
from drivers.errors import BenchError
from test_plans.discovery import in_file, plans, unknown
from test_plans.execution import execute
from test_plans.operator import Script
from test_plans.run import PlanError

if TYPE_CHECKING:
    from bench_records.result import Result
    from diagnosis.finding import Finding
    from drivers.bench import Bench
    from test_plans.operator import Operator, Reply
    from test_plans.plan import Plan
    from test_plans.suspension import Suspension

#: The simulated rig in the memory of this process.
VIRTUAL: Final = "virtual"

_LOG: Final = logging.getLogger("astb")


def open_bench(
    rig: str | Path = VIRTUAL,
    *,
    virtual: bool = False,
    seed: int | None = None,
    effects: Mapping[str, str] | None = None,
) -> "Bench":
    """Return a connected bench on ``rig``, not yet armed. ``rig`` is the path of a rig file, or a name of `astb list
    rigs`.

    The rig ``virtual`` is simulated in virtual time and in this process; ``virtual=True`` does the same with any
    simulated rig. If a simulated rig in real time does not answer, it is started, and stopped with the bench. ``seed``
    determines the sensors of a simulated rig and their noise. ``effects`` adds effects by name, with amplitude and
    unit, as `astb list effects` shows them: ``{"leak.left": "0.2 mm2"}``.

    Use the bench with ``with``, or call ``close``; the end of the interpreter closes it in any case. Closing disarms
    the bench; the rig then holds its position until the springs are vented.

    Raises RigFileError for an invalid rig file or for effects of a real rig, ParameterError for an unknown effect, and
    LinkLost, MapMismatch or NotCommander if the bench cannot command the rig.
    """
    file, path = find_rig(rig)
    if effects:
        file = _with_effects(file, effects)
    with ExitStack() as stack:
        session = stack.enter_context(open_session(file, path, virtual=virtual, seed=seed, say=_LOG.info))
        bench = session.bench
        bench.about = describe(session, file)
        bench.connect()
        with suppress(BenchError):  # so that devices can show them; a reader requests its own signals
            bench.settings.in_force()
            bench.settings.contacts()
        atexit.register(bench.close)
        bench.closing.callback(atexit.unregister, bench.close)
        bench.closing.push(stack.pop_all())
    return bench


def run_plan(
    plan: "str | Plan",
    on: "str | Path | Bench" = VIRTUAL,
    out: str | Path = "runs",
    *,
    seed: int | None = None,
    report: bool = True,
    answers: "Operator | Mapping[str, Reply] | None" = None,
    suspension: "Suspension | None" = None,
) -> "tuple[Result, Path]":
    """Run a plan, given by name or as an object, and return its result and the directory of its record.

    ``on`` is an open bench, or a rig as for `open_bench`. ``answers`` are the answers to the questions of the plan: an
    operator, or texts by question or manual action (``*`` for all others). With ``suspension`` another thread can pause
    the run and continue it.

    The record is a new directory in ``out``, with a report unless ``report`` is False. Existing files are not changed.
    After an interrupt, as in a notebook, the rig comes to rest, the record is completed, and KeyboardInterrupt is
    raised.

    Raises PlanError for an unknown plan, and the errors of `open_bench`. A failure of the rig raises nothing: the
    verdict is *blocked*, and the reason states the cause.
    """
    operator = Script(answers) if isinstance(answers, Mapping) else answers
    chosen = find_plan(plan)
    with ExitStack() as stack:
        bench = stack.enter_context(open_bench(on, seed=seed)) if isinstance(on, str | Path) else on
        directory = new_directory(Path(out), chosen.name)
        about = bench.about
        stack.enter_context(undisturbed())
        try:
            result = execute(
                chosen,
                bench,
                directory,
                meta=about,
                rig=about.get("rig", ""),
                seed=about.get("seed"),
                operator=with_hand(operator, bench.hand),
                suspension=suspension,
            )
        except KeyboardInterrupt:  # a record and a result exist in this case too
            _finish(directory, report)
            raise
    _finish(directory, report)
    return result, directory


def _finish(directory: Path, report: bool) -> None:
    write_sums(directory)
    if report:
        write_report(directory)


def diagnose_record(
    *records: str | Path,
    effects: Iterable[str] | None = None,
    model: str = "astb",
    seed: int = 1,
    out: str | Path | None = None,
) -> "Finding":
    """Diagnose ``records``, directories of runs on the bench: find the errors of a ``model`` and their causes.

    ``effects`` are the names of the candidates; a name without a place stands for all places. The default is the whole
    catalogue, which takes minutes. ``out`` is a directory for the finding, its report and the extended model.

    Raises DiagnosisError, RecordError or ParameterError; the text names the file, the value and the correct form.
    """
    from astb.diagnose import chosen_effects, clear_results, conclude, read_data
    from diagnosis.engine.config import Config
    from diagnosis.engine.diagnose import diagnose

    parameters = load(model)
    simulator, dataset = read_data([Path(record) for record in records], None, parameters)
    asked = None if effects is None else ",".join(effects)
    config = Config(seed=seed, effects=chosen_effects(asked, simulator, parameters.effects))
    if out is None:
        return diagnose(dataset, simulator, config)
    clear_results(Path(out))
    return conclude(simulator, dataset, config, model, Path(out), lambda text, _done: _LOG.info(text))


def _with_effects(file: RigFile, effects: Mapping[str, str]) -> RigFile:
    """Return the rig with ``effects`` in addition to those of its file."""
    if file.simulation is None:
        raise RigFileError(f"{file.name} is a real rig, but effects={dict(effects)!r} needs a simulated rig")
    simulation = replace(file.simulation, effects=file.simulation.effects | dict(effects))
    return replace(file, simulation=simulation)


def find_plan(plan: "str | Plan") -> "Plan":
    """Return a plan: by its name, from a Python file that declares one, or a plan object unchanged.

    Raises PlanError, with similar names, if the name is unknown, or if the file does not declare exactly one plan.
    """
    if not isinstance(plan, str):
        return plan
    if plan.endswith(".py"):
        found = in_file(Path(plan))
        if len(found) != 1:
            raise PlanError(
                f"{plan} declares several plans, {', '.join(found)}; give one of these plan objects "
                "instead of the file"
            )
        return next(iter(found.values()))
    if plan not in plans():
        raise PlanError(unknown(plan))
    return plans()[plan]
