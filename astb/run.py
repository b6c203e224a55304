"""`astb run`: plans on a rig, with progress on the screen and a directory of files for each."""

import gc
import platform
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from astb.rig_file import RigFile
from astb.session import MAP_HASH, Session, open_session
from bench_protocol.clock import utc_date
from bench_records.layout import JUNIT, META, PARQUET, REPORT, RESULT, STREAM, RecordError
from bench_records.result import Check, CheckVerdict, Outcome, Result

if TYPE_CHECKING:
    from test_plans.plan import Plan

_COLOURS: Final = {
    CheckVerdict.PASS: "green",
    CheckVerdict.MARGINAL: "yellow",
    CheckVerdict.FAIL: "red",
    CheckVerdict.ERROR: "red",
}
_LIBRARIES: Final = ("numpy", "numba", "pymodbus", "python-can")


class Screen:
    """What the operator sees: a bar with the present phase, and a line for every check; a plan's watcher."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("[bold]{task.fields[plan]}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("{task.description}"),
            console=console,
            transient=True,
        )
        self._task: TaskID | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._task is not None:
            self._progress.stop()

    def begin(self, plan: str) -> None:
        """Show that ``plan`` begins."""
        if self._task is not None:
            self._progress.remove_task(self._task)
        self._progress.start()
        self._task = self._progress.add_task("", total=1.0, plan=plan)

    def say(self, text: str) -> None:
        """Show what the plan is doing now."""
        if self._task is not None:
            self._progress.update(self._task, description=text)
        else:
            self._console.print(text, style="dim", highlight=False)

    def progress(self, fraction: float) -> None:
        """Show how much of the plan is done."""
        if self._task is not None:
            self._progress.update(self._task, completed=fraction)

    def follow(self, text: str, fraction: float) -> None:
        """Show what is done now and how much of all is."""
        self.say(text)
        self.progress(fraction)

    def checked(self, check: Check) -> None:
        """Show a check and its verdict."""
        self._console.print(
            f"  {check}", style=_COLOURS[check.verdict], highlight=False, markup=False, soft_wrap=True
        )

    def conclude(self, result: Result, directory: Path) -> None:
        """Show the verdict on a plan and where its report lies."""
        colour = {Outcome.PASS: "green", Outcome.FAIL: "red", Outcome.BLOCKED: "magenta"}[result.verdict]
        reason = f": {result.reason}" if result.reason else ""
        self._console.print(
            f"{result.plan}: {result.verdict.upper()}{reason}", style=f"bold {colour}", markup=False
        )
        self._console.print(f"  report: {directory / REPORT}", highlight=False, markup=False, soft_wrap=True)


def run_plans(
    plans: Sequence["Plan"], rig: RigFile, path: Path, *, virtual: bool, seed: int | None, out: Path
) -> list[Outcome]:
    """Run ``plans`` one after the other; return their verdicts.

    In real time they share one session with the rig, and a blocked plan is the last; in virtual time each starts with
    a new one, so that what a plan measures does not depend on what ran before.
    """
    from bench_records.report import write_report
    from test_plans.execution import execute

    is_virtual = virtual or rig.time == "virtual"
    verdicts: list[Outcome] = []
    with Screen(Console()) as screen:
        for session, part in _sessions(plans, rig, path, is_virtual, seed, screen):
            for plan in part:
                directory = out / plan.name
                prepare(directory, screen)
                screen.begin(plan.name)
                with undisturbed():
                    result = execute(
                        plan,
                        session.bench,
                        directory,
                        meta=describe(session, rig),
                        rig=rig.name,
                        seed=session.seed,
                        watcher=screen,
                    )
                screen.say("report")
                write_report(directory)
                screen.conclude(result, directory)
                verdicts.append(result.verdict)
                if result.verdict is Outcome.BLOCKED and plan is not part[-1]:
                    # Whatever broke may have left air in the springs: somebody has to look before the next plan.
                    screen.say(f"the bench is as {plan.name} left it; what should follow was not run")
                    break
    return verdicts


def _sessions(
    plans: Sequence["Plan"], rig: RigFile, path: Path, virtual: bool, seed: int | None, screen: Screen
) -> Iterator[tuple[Session, Sequence["Plan"]]]:
    groups = [[plan] for plan in plans] if virtual else [list(plans)]
    for group in groups:
        with (
            open_session(rig, path, virtual=virtual, seed=seed, say=screen.say) as session,
            connected(session),
        ):
            yield session, group


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
    """Keep the garbage collector short while the block lasts.

    With the drawing of an earlier report in memory a full collection takes more than 100 ms, in which no command
    leaves this process: the rig would hold. What exists now is set aside; what comes is little.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def describe(session: Session, rig: RigFile) -> dict[str, Any]:
    """Return what a record says of its origin; of a virtual run nothing that changes from day to day."""
    facts: dict[str, Any] = {
        "rig": rig.name,
        "rig_description": rig.description,
        "map_hash": MAP_HASH,
        "time": "virtual" if session.virtual else "real",
        "versions": {"astb": version("astb"), **{name: version(name) for name in _LIBRARIES}},
        "seed": session.seed,
    }
    if session.parameters is not None:
        facts["parameters"] = {"name": session.parameters.name, "sha256": session.parameters.digest()}
        if session.parameters.effects:
            facts["parameters"]["effects"] = session.parameters.effects
    if not session.virtual:
        facts["date"] = utc_date()
        facts["machine"] = f"{platform.system()} {platform.release()}, Python {platform.python_version()}"
    return facts


def prepare(directory: Path, screen: Screen) -> None:
    """Make room for a run in ``directory``: an earlier run's files go, a killed run's record is kept beside.

    Raises RecordError where the directory cannot be used.
    """
    from bench_records.recorder import recover

    if (directory / STREAM).exists():
        number = 1
        while (kept := directory.with_name(f"{directory.name}.cut-off-{number}")).exists():
            number += 1
        directory.rename(kept)
        try:
            saved = str(recover(kept))
        except RecordError as error:  # cut off before there was anything to save
            saved = str(error)
        screen.say(f"an earlier run was cut off; its record is kept in {kept}: {saved}")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name in (PARQUET, META, RESULT, REPORT, JUNIT):
            (directory / name).unlink(missing_ok=True)
    except OSError as error:
        raise RecordError(f"{directory} cannot be used for the record: {error.strerror}") from None
