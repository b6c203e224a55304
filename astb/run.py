"""`astb run`: plans on a rig, with progress on the screen and a directory of files for each run."""

import gc
import getpass
import platform
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from astb.display import ProgressDisplay
from astb.live.door import Door, opened_door
from astb.live.model import Live
from astb.live.outline import kept_outline
from astb.operators import with_hand
from astb.reservations import NotReserved, Reservation, reserved_for_others
from astb.rig_file import RigFile, RigFileError
from astb.rig_limits import known_limits
from astb.run_queue import Ticket, queued, wait_while
from astb.session import MAP_HASH, Session, open_session
from astb.software import commit
from astb.tables import shared_console
from astb.watched import watched
from bench_protocol.clock import utc_date
from bench_protocol.named_files import label
from bench_protocol.runtime.own_process import available_signals
from bench_protocol.units import UNITS, mbar
from bench_records.checksums import FRAMES, write_sums
from bench_records.disk import NotKept, begun
from bench_records.layout import RESULT, RecordError
from bench_records.printing import write_pdf
from bench_records.report import write_report
from bench_records.result import Outcome, Result, read_result
from bench_records.run_folder import circumstances
from bench_records.twin import read_twin
from bench_sim.parameters.effects import show_effect
from drivers.can_files.frames import CanLogError
from test_plans.execution import IN_TEAR_DOWN, execute
from test_plans.holding import can_be_held
from test_plans.interruptions import Interruptions
from test_plans.operator import QuestionBox
from test_plans.suspension import Suspension

if TYPE_CHECKING:
    from astb.messages import Messages
    from bench_sim.parameters import Parameters
    from test_plans.operator import Operator
    from test_plans.plan import Plan
    from test_plans.specimen import Specimen

_LIBRARIES: Final = ("numpy", "numba", "pymodbus", "python-can")


@dataclass(frozen=True, slots=True)
class Keeping:
    """Additional options of a run: operator, ambient conditions, recording of all CAN frames, printing of the report.

    Also the receivers of messages at questions and at the end, and whether the rig is compared with its model (twin).
    """

    operator: str = ""
    ambient: str = ""
    frames: bool = False
    pdf: bool = False
    messages: "Messages | None" = None
    twin: bool = False
    wait: bool = False  #: until earlier runs and reservations of others have ended

    def called(self, operator: "Operator | None", plan: "Plan") -> "Operator | None":
        """Return ``operator``, with a message for each question of ``plan`` if there are receivers."""
        return self.messages.operator(operator, plan.name) if self.messages else operator


def run_plans(
    plans: Sequence["Plan"],
    rig: RigFile,
    path: Path,
    *,
    virtual: bool,
    seed: int | None,
    out: Path,
    specimen: "Specimen | None" = None,
    operator: "Operator | None" = None,
    keeping: Keeping = Keeping(),
    ended: Callable[[Result, Path], object] = lambda result, directory: None,
) -> list[Result]:
    """Run ``plans`` one after the other, each into a new directory in ``out``; return their results.

    ``ended`` is called with the result and the directory of each run.

    The default of ``specimen`` is the bench's own; ``operator`` answers questions. In real time the plans share one
    session with the rig, and no further plan runs after a blocked plan or tear-down. In virtual time each plan
    starts with a new session, so that the results do not depend on earlier plans.
    """
    is_virtual = virtual or rig.time == "virtual"
    results: list[Result] = []
    with (
        ProgressDisplay(shared_console()) as display,
        held_by_keyboard() as suspension,
        nullcontext() if is_virtual else _queue_turn(plans, rig, path, keeping, display.say),
        nullcontext()
        if is_virtual
        else opened_door(path, Door(lambda: display.live, suspension, box_of(operator))),
    ):
        if keeping.messages:
            keeping.messages.warn = display.warn
        for session, part in _sessions(plans, rig, path, is_virtual, seed, display):
            for plan in part:
                result, directory = run_plan(
                    plan, session, rig, out, plan.name, display, specimen, operator, keeping, suspension
                )
                results.append(result)
                ended(result, directory)
                if left_in_trouble(result) and plan is not part[-1]:
                    # After any error there may be air in the springs: a user must check before the next plan.
                    display.say(
                        f"the next plans were not run, because {plan.name} may have left air in the springs: look first"
                    )
                    break
    return results


@contextmanager
def _queue_turn(
    plans: Sequence["Plan"], rig: RigFile, path: Path, keeping: Keeping, say: Callable[[str], None]
) -> Iterator[None]:
    """Enter the queue of the rig, and wait for the turn if ``keeping`` requests it.

    If it does not, raises NotReserved if the plans would overlap a reservation of another operator.
    """
    by, lasts = keeping.operator or getpass.getuser(), sum(plan.lasts for plan in plans)

    def report(before: list[Ticket]) -> None:
        say(f"waiting for {rig.name} at place {len(before)}, after {'; then '.join(map(str, before))}")

    def report_reserved(others: list[Reservation]) -> None:
        say(f"waiting for {rig.name}, after {'; then '.join(map(str, others))}")

    def others() -> list[Reservation]:
        return reserved_for_others(path, by, lasts)

    if not keeping.wait and (found := others()):
        raise NotReserved(
            f"{', '.join(plan.name for plan in plans)} by {by} would overlap {found[0]}, on {rig.name}; add "
            f'--wait to start afterwards, or give its operator with --operator "{found[0].by}"'
        )
    while True:
        if keeping.wait:  # outside the queue, where it would keep the holder of the reservation waiting
            wait_while(others, report_reserved)
        with queued(path, [plan.name for plan in plans], lasts, by, report if keeping.wait else None):
            if keeping.wait and others():  # since it entered the queue
                continue
            yield
            return


def deviates(directory: Path) -> bool:
    """Return whether the run in ``directory`` deviated from a model that ran next to it."""
    with suppress(RecordError):
        story = read_twin(directory)
        return story is not None and bool(story.deviations)
    return False


def left_in_trouble(result: Result) -> bool:
    """Return whether a run may have left the bench not at rest: it was blocked, or its tear-down was."""
    return result.verdict is Outcome.BLOCKED or any(text.startswith(IN_TEAR_DOWN) for text in result.warnings)


def run_plan(
    plan: "Plan",
    session: Session,
    rig: RigFile,
    out: Path,
    name: str,
    display: ProgressDisplay,
    specimen: "Specimen | None" = None,
    operator: "Operator | None" = None,
    keeping: Keeping = Keeping(),
    suspension: Suspension | None = None,
) -> tuple[Result, Path]:
    """Run ``plan`` and write its report; return the result and the directory, ``out/name`` or one next to it.

    A KeyboardInterrupt, by Ctrl-C or a signal, is raised again after tear-down and report.
    """
    directory = new_directory(out, name)
    meta = describe(session, rig)
    if keeping.operator:
        meta["operator"] = keeping.operator
    if keeping.ambient:
        meta["ambient"] = keeping.ambient
    display.introduce(" · ".join(circumstances(meta)))
    display.begin(plan.name, _live(plan, session, rig, directory, operator, keeping, suspension))
    stopped: KeyboardInterrupt | None = None
    try:
        with (
            watched(directory, keeping.twin, session.bench.clock, display.warn) as twin,
            undisturbed(),
            kept_frames(session, directory if keeping.frames else None),
        ):
            result = execute(
                plan,
                session.bench,
                directory,
                meta=meta,
                rig=rig.name,
                seed=session.seed,
                watcher=display,
                specimen=specimen,
                operator=with_hand(keeping.called(operator, plan), session.bench.hand),
                suspension=suspension,
                twin=twin,
            )
    except KeyboardInterrupt as stop:
        if not (directory / RESULT).exists():  # stopped once more, while the files were written
            raise
        result, stopped = read_result(directory), stop
    with Interruptions():  # a later signal takes effect when the report is written
        report = _reported(directory, display)
    if report and keeping.pdf:
        _print(report, display)
    display.conclude(result, directory, deviates=deviates(directory))
    if keeping.messages:
        keeping.messages.ended(result, directory)
    if stopped:
        if str(stopped) not in result.reason:
            display.warn(str(stopped))
        raise stopped
    return result, directory


def _reported(directory: Path, display: ProgressDisplay) -> Path | None:
    """Write checksums and report of a run; return the report.

    A disk error gives a warning and None, so the run is not lost.
    """
    display.say("writing the report")
    try:
        write_sums(directory)
        return write_report(directory)
    except RecordError as error:
        display.warn(f"{error}; make the report later with `astb report {directory}`")
        return None


def _print(report: Path, display: ProgressDisplay) -> None:
    """Print the report. A failure gives a warning, because the report can be printed later."""
    try:
        display.say(f"printed: {write_pdf(report)}")
    except RecordError as error:
        display.warn(f"{error}; print the report later with `astb report {report.parent} --pdf`")


def _live(
    plan: "Plan",
    session: Session,
    rig: RigFile,
    directory: Path,
    operator: "Operator | None",
    keeping: Keeping,
    suspension: Suspension | None,
) -> Live:
    """Return the model of a run that begins now, for displays."""
    return Live(
        plan.name,
        session.bench,
        rig=rig.name,
        operator=keeping.operator,
        limits=known_limits(rig),
        record=str(directory.resolve()),
        outline=kept_outline(directory.parent, plan.name, plan.written),
        box=box_of(operator),
        suspension=suspension,
        can_hold=can_be_held(plan),
    )


def box_of(operator: "Operator | None") -> QuestionBox | None:
    """Return the box in which questions wait until this operator answers; None if the operator has no box."""
    return operator if isinstance(operator, QuestionBox) else None


@contextmanager
def kept_frames(session: Session, directory: Path | None) -> Iterator[None]:
    """Record every frame on the rig's CAN bus, including the commander's own, in ``directory`` during the block."""
    if directory is None:
        yield
        return
    from drivers.can_log import CanLog

    if session.listen is None:
        raise RigFileError(
            "--keep-frames needs a rig with the ASTB protocol; this rig has its own wiring; omit it"
        )
    receiver = session.bench.receiver

    def fail(failure: CanLogError) -> None:
        receiver.failure = receiver.failure or failure  # the run ends at once, as for its own record

    try:
        log = CanLog(session.listen(), directory / FRAMES, fail)
    except CanLogError as error:
        raise NotKept(str(error)) from None
    try:
        yield
    finally:
        try:
            log.close()
        except CanLogError as error:
            if str(error) != str(receiver.failure):
                raise NotKept(str(error)) from None


def _sessions(
    plans: Sequence["Plan"],
    rig: RigFile,
    path: Path,
    virtual: bool,
    seed: int | None,
    display: ProgressDisplay,
) -> Iterator[tuple[Session, Sequence["Plan"]]]:
    groups = [[plan] for plan in plans] if virtual else [list(plans)]
    for group in groups:
        with (
            open_session(rig, path, virtual=virtual, seed=seed, say=display.say) as session,
            connected(session),
        ):
            yield session, group


@contextmanager
def held_by_keyboard() -> Iterator[Suspension]:
    """Yield a suspension: Ctrl-Z holds the run at the next hold point of its plan, a second Ctrl-Z continues it.

    Only the main thread can receive the signal.
    """
    suspension = Suspension()
    numbers = available_signals("SIGTSTP")
    if not numbers or threading.current_thread() is not threading.main_thread():
        yield suspension
        return
    before = signal.signal(numbers[0], lambda *_: suspension.toggle("Ctrl-Z"))
    try:
        yield suspension
    finally:
        signal.signal(numbers[0], before)


@contextmanager
def connected(session: Session) -> Iterator[None]:
    """Connect the bench while the block lasts."""
    session.bench.connect()
    try:
        yield
    finally:
        session.bench.close()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Keep garbage collections short during the block.

    With the drawing of an earlier report in memory a full collection takes more than 100 ms, in which no command
    leaves this process: the rig would hold. Existing objects are excluded; few new ones appear.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def describe(session: Session, rig: RigFile) -> dict[str, Any]:
    """Return the metadata on the origin of a record.

    For a virtual run they contain nothing that changes from day to day.
    """
    facts: dict[str, Any] = {
        "rig": rig.name,
        "rig_description": rig.description,
        "map_hash": MAP_HASH,
        "simulated": rig.simulation is not None,
        "time": "virtual" if session.virtual else "real",
        "commit": commit(),
        "versions": {"astb": version("astb"), **{name: version(name) for name in _LIBRARIES}},
        "seed": session.seed,
    }
    if session.wiring is not None:
        facts["wiring"] = {"file": label(session.wiring.where), "sha256": session.wiring.digest}
    if session.parameters is not None:
        facts["parameters"] = {"name": session.parameters.name, "sha256": session.parameters.digest()}
        facts["ambient"] = _surroundings(session.parameters)
        if session.parameters.effects:
            facts["parameters"]["effects"] = session.parameters.effects
            facts["effects"] = {
                name: show_effect(name, values) for name, values in session.parameters.effects.items()
            }
    if (simulation := rig.simulation) is not None:
        if simulation.change:
            facts["change"] = simulation.change
        if simulation.faults:
            facts["faults"] = [str(one) for one in simulation.faults]
        if simulation.sealed:
            facts["sealed_effects"] = True
        if simulation.spring:
            spring = Path(simulation.spring)
            facts["spring"] = {"fmu": spring.name, "sha256": sha256(spring.read_bytes()).hexdigest()}
    if not session.virtual:
        facts["date"] = utc_date()
        facts["machine"] = f"{platform.system()} {platform.release()}, Python {platform.python_version()}"
    return facts


def _surroundings(parameters: "Parameters") -> str:
    """Return ambient temperature and pressure of a simulated rig as text."""
    warmth = float(parameters.record.ambient_temperature) - UNITS["degC"].zero
    return f"{warmth:.1f} °C, {float(parameters.record.atmospheric_pressure) / mbar:.0f} hPa"


def new_directory(out: Path, name: str) -> Path:
    """Create the directory of a run in ``out`` and return it: ``name``, or ``name-2`` and so on next to earlier runs.

    Existing files are not changed. Raises RecordError if no directory can be made, NotKept if the disk fails.
    """
    for number in count(1):
        directory = out / (name if number == 1 else f"{name}-{number}")
        with begun(directory, f"the record's folder {directory}"):
            directory.mkdir(parents=True, exist_ok=True)
            if not any(directory.iterdir()):
                return directory
    raise AssertionError("numbers do not end")
