"""A plugin of pytest: `pytest --rig local` gives tests the fixtures `rig`, `bench` and `run`."""

import logging
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

if TYPE_CHECKING:
    from astb.rig_file import RigFile
    from bench_records.result import Result
    from drivers.bench import Bench
    from test_plans.operator import Reply
    from test_plans.plan import Plan

_LOG: Final = logging.getLogger("astb")
#: Whether a test has asked for the bench.
_ASKED: Final = pytest.StashKey[bool]()


class Blocked(Exception):
    """A plan could not judge the product; the text names the side at fault."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options `--rig`, `--rig-records` and `--plan-set`."""
    group = parser.getgroup("astb", "test bench for air springs")
    group.addoption(
        "--rig",
        dest="astb_rig",
        default="virtual",
        metavar="RIG",
        help="Rig of the fixtures rig, bench and run: a file, or a name of `astb list rigs`. Default: simulated.",
    )
    group.addoption(
        "--rig-records",
        dest="astb_records",
        type=Path,
        metavar="DIR",
        help="Where `run` leaves records and reports. Default: records alone, in pytest's temporary directory.",
    )
    group.addoption(
        "--plan-set",
        dest="astb_settings",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="Set a parameter of the plans of `pytest --pyargs astb.catalogue`, such as amplitude=20mm; repeatable.",
    )


@pytest.fixture(scope="session")
def _rig_and_path(pytestconfig: pytest.Config) -> "Iterator[tuple[RigFile, Path]]":
    """The rig file and its path. If a simulated rig in real time does not answer, it is started, and stopped at the end
    of the session.
    """
    from astb.rig_file import RigFileError, find_rig
    from astb.session import answers, started

    try:
        rig, path = find_rig(pytestconfig.getoption("astb_rig"))
        with ExitStack() as stack:
            if rig.time == "real" and rig.simulation and not answers(rig):
                stack.enter_context(started(rig.simulation, path, None, _LOG.info))
            yield rig, path
    except RigFileError as error:
        raise pytest.fail.Exception(f"--rig: {error}", pytrace=False) from None


@pytest.fixture(scope="session")
def rig(_rig_and_path: "tuple[RigFile, Path]") -> "RigFile":
    """The rig file that `--rig` names: `rig.name`, `rig.simulation`, …"""
    return _rig_and_path[0]


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> "Iterator[Bench]":
    """A connected bench; at the end of the test it is made safe (no air, no forces, disarmed) and closed."""
    request.node.stash[_ASKED] = True
    request.getfixturevalue("_rig_and_path")
    from astb.api import open_bench
    from astb.run import undisturbed

    with open_bench(request.config.getoption("astb_rig")) as opened, undisturbed():
        yield opened
        _make_safe(opened)


@pytest.fixture
def run(bench: "Bench", request: pytest.FixtureRequest, tmp_path: Path) -> "Callable[..., Result]":
    """Run a plan on `bench`, given by its name or as an object, and return its result: `run("aw0")`. Raises Blocked
    without a verdict.

    Answers to the questions of the plan are given with it: `run(plan, {"press the emergency stop*": "done"})`.
    """
    from astb.api import run_plan
    from bench_records.result import Outcome

    records = request.config.getoption("astb_records")

    def run_one(plan: "str | Plan", answers: "Mapping[str, Reply] | None" = None) -> "Result":
        out = records or tmp_path
        result, directory = run_plan(plan, bench, out, report=bool(records), answers=answers)
        lines = [f"{result.plan}: {result.verdict}, record in {directory}", *map(str, result.checks)]
        request.node.add_report_section("call", "plan", "\n".join(lines))
        if result.verdict is Outcome.BLOCKED:
            raise Blocked(f"{result.plan}: {result.reason}")
        return result

    return run_one


class _NoLog:
    """An event log that stores nothing."""

    def event(self, time: int, kind: str, text: str, **data: Any) -> None:
        pass


def _make_safe(bench: "Bench") -> None:
    from bench_protocol.words import FAULT_STATES, LIVE_STATES
    from drivers.errors import BenchError, RigFault
    from test_plans.air_left import air_at_risk
    from test_plans.run import Run
    from test_plans.steps import make_safe

    if bench.state not in {*LIVE_STATES, *FAULT_STATES}:
        return
    try:
        make_safe(Run(bench, _NoLog()))
    except BenchError as error:
        if air := air_at_risk(bench):
            raise RigFault(f"{air}; {error}", error.fault) from error
        raise


# -- blocked: the bench kept the product from being judged -------------------------------------------------------------


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Mark tests as blocked if the bench prevented a verdict."""
    report = yield
    error = call.excinfo.value if call.excinfo and item.stash.get(_ASKED, False) else None
    if report.failed and error and (why := _whose_fault(error)):
        # As text, so that the workers of pytest-xdist can send it, too.
        report.blocked = why  # type: ignore[attr-defined]
        report.longrepr = f"blocked by {why}"
    elif report.failed and error and _is_misuse(error):
        report.misuse = True  # type: ignore[attr-defined]
        report.longrepr = str(error)
    return report


def _is_misuse(error: BaseException) -> bool:
    """Return whether the test uses an unknown plan."""
    from test_plans.run import PlanError

    return isinstance(error, PlanError)


def _whose_fault(error: BaseException) -> str:
    from drivers.errors import BenchError
    from test_plans.execution import WHOSE

    if isinstance(error, BenchError):
        return f"{WHOSE[error.fault]}: {error}"
    return str(error) if isinstance(error, Blocked) else ""


def pytest_report_teststatus(report: pytest.CollectReport | pytest.TestReport) -> tuple[str, str, str] | None:
    """Count blocked tests and unknown plans separately from failures."""
    if getattr(report, "misuse", False):
        return "error", "E", "ERROR"
    return ("blocked", "B", "BLOCKED") if getattr(report, "blocked", "") else None


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Report the blocked tests and the causes."""
    blocked = terminalreporter.stats.get("blocked", [])
    if blocked:
        terminalreporter.section("BLOCKED: the product was not judged")
    for report in blocked:
        terminalreporter.line(f"{report.nodeid} ({report.when}): {report.blocked}")
