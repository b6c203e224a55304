"""What stands behind ``import astb``: a bench to try things on, and plans that run on it."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from astb.rig_file import RigFile, RigFileError, Simulation, read
from bench_protocol.suggestion import meant

if TYPE_CHECKING:
    from bench_records.result import Result
    from drivers.bench import Bench
    from test_plans.plan import Plan

#: The rig that needs no file: the simulated one in the memory of this process.
VIRTUAL: Final = "virtual"

_LOG: Final = logging.getLogger("astb")


@contextmanager
def open_bench(
    rig: "str | Path" = VIRTUAL, *, virtual: bool = False, seed: int | None = None
) -> "Iterator[Bench]":
    """Yield a connected bench on ``rig``, not yet armed: the path of a rig file, or its name in ``rigs/``.

    ``virtual`` is a simulated rig in virtual time and in this process, and what ``virtual=True`` makes of any simulated
    rig. One in real time that does not answer is started, and stopped at the end. ``seed`` draws a simulated rig's
    sensors and their noise. At the end the bench is disarmed and closed; air that is in the springs stays there.

    RigFileError for a file that is none, LinkLost, MapMismatch or NotCommander for a rig that cannot be commanded.
    """
    from astb.run import connected
    from astb.session import open_session

    file, path = find_rig(rig)
    with open_session(file, path, virtual=virtual, seed=seed, say=_LOG.info) as session, connected(session):
        yield session.bench


def run_plan(
    plan: "str | Plan", rig: "str | Path" = VIRTUAL, out: str | Path = "runs", *, seed: int | None = None
) -> "tuple[Result, Path]":
    """Run a plan, by its name or itself, on ``rig`` as `open_bench` knows it; return its result and its record.

    The record is a new directory in ``out``, with a report; what lies there already is not touched. PlanError for a
    plan that there is not, and what `open_bench` raises. A rig that breaks on the way raises nothing: the verdict is
    *blocked*, the reason says whose fault it was.
    """
    from astb.run import connected, describe, new_directory, undisturbed
    from astb.session import open_session
    from bench_records.report import write_report
    from test_plans.execution import execute

    chosen = find_plan(plan)
    file, path = find_rig(rig)
    with (
        open_session(file, path, seed=seed, say=_LOG.info) as session,
        connected(session),
        undisturbed(),
    ):
        directory = new_directory(Path(out), chosen.name)
        about = describe(session, file)
        result = execute(chosen, session.bench, directory, meta=about, rig=file.name, seed=session.seed)
    write_report(directory)
    return result, directory


def find_rig(rig: str | Path) -> tuple[RigFile, Path]:
    """Return a rig and the path of its file, by that path or by its name: ``local`` is ``rigs/local.toml``.

    ``virtual`` needs no file. RigFileError where there is none, or where it is not one.
    """
    path = Path(rig)
    if path.suffix != ".toml" and not path.exists():
        path = Path("rigs", f"{rig}.toml")
        if not path.exists():
            if rig == VIRTUAL:
                return RigFile(VIRTUAL, time="virtual", simulation=Simulation()), path
            names = sorted({VIRTUAL, *(file.stem for file in Path("rigs").glob("*.toml"))})
            raise RigFileError(
                f"there is no rig {str(rig)!r}: the path of a rig file, or {' or '.join(names)}"
            )
    return read(path), path


def find_plan(plan: "str | Plan") -> "Plan":
    """Return a plan by its name, or itself. PlanError, with what is nearest, if there is none of this name."""
    from test_plans.discovery import plans
    from test_plans.run import PlanError

    if not isinstance(plan, str):
        return plan
    known = plans()
    if plan not in known:
        raise PlanError(f"there is no plan {plan!r}; {meant(plan, known)}")
    return known[plan]
