"""`astb investigate`: screening, diagnosis, and the run that separates the causes best, in a loop until there is a
verdict.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

import msgspec

from astb.diagnose import REPORT, clear_results, conclude, read_data, show
from astb.display import ProgressDisplay
from astb.menu import Offer, offers
from astb.run import connected, run_plan
from astb.session import Session, open_session
from astb.tables import plain_console
from bench_protocol.units import minutes, s
from bench_records.layout import RecordError
from bench_records.result import Outcome
from bench_sim.parameters import load
from bench_sim.parameters.loading import read_value
from diagnosis.engine.config import Config
from diagnosis.finding import Finding, Verdict
from diagnosis.report.page import InvestigationHistory, RunOfInvestigation, write_report
from test_plans.execution import blocked_by_the_link
from test_plans.plans.screening import SCREENING
from test_plans.plans.separating import MENU
from test_plans.programmes.motions import Programme
from test_plans.programmes.perform import lasts, programme_plan

if TYPE_CHECKING:
    from astb.rig_file import RigFile
    from diagnosis.report.page import InvestigationHistory

LOG: Final = "investigation.json"
#: Smallest predicted BIC gap of a useful run: with a smaller gap, two causes are not distinguished.
LEAST_GAP: Final = 10.0
#: Maximum number of repetitions of a run with a small gap: causes that need more runs hardly differ.
REPEATS: Final = 5
#: Verdicts after which another run may help.
UNDECIDED: Final = (Verdict.AMBIGUOUS, Verdict.UNRESOLVED)
#: Maximum number of consecutive tries of a run that the link or this machine blocks.
ATTEMPTS: Final = 3
#: Period in which the commander sends to the bench while a diagnosis computes.
KEEP_ALIVE: Final = 1 * s

T = TypeVar("T")


class InvestigationStep(msgspec.Struct, frozen=True, kw_only=True):
    """One run on the bench and the conclusion from all data so far; times in minutes of the bench."""

    plan: str
    why: str
    record: str
    minutes: float
    outcome: str
    verdict: str = ""
    sentence: str = ""
    causes: list[str] = []
    rivals: list[str] = []


class Investigation(msgspec.Struct, kw_only=True):
    """The log of an investigation: the runs and their reasons, the results, and the reason of the end."""

    rig: str
    budget: float  #: minutes of the bench
    steps: list[InvestigationStep] = []
    ended: str = ""

    @property
    def spent(self) -> float:
        """Minutes of the bench so far."""
        return sum(step.minutes for step in self.steps)

    def write(self, directory: Path) -> Path:
        """Write the log into ``directory`` and return its path."""
        path = directory / LOG
        path.write_bytes(msgspec.json.format(msgspec.json.encode(self), indent=1) + b"\n")
        return path


def investigate_rig(
    rig: "RigFile",
    path: Path,
    *,
    virtual: bool,
    seed: int | None,
    budget: str,
    model: str,
    out: Path,
) -> bool:
    """Run tests on ``rig`` to find errors of ``model``. Write records, log and finding into ``out``, and print the
    finding. Return whether there is a finding.

    Raises RigFileError, ParameterError, DiagnosisError, RecordError or BenchError, like `astb run` and `astb diagnose`.
    """
    allowed = read_value("--budget", budget, "s") / minutes
    parameters = load(model)
    clear_results(out)
    console, drawn = plain_console(), 1 if seed is None else seed
    last: Finding | None = None

    with (
        ProgressDisplay(console) as display,
        open_session(rig, path, virtual=virtual, seed=seed, say=display.say) as session,
    ):

        def diagnose(records: Sequence[Path]) -> Finding:
            nonlocal last
            display.begin("diagnosis")
            simulator, dataset = read_data(records, None, parameters)
            config = Config(seed=drawn)
            last = conclude(simulator, dataset, config, model, out, display.follow)
            return last

        log = investigate(
            session, rig, out, first=SCREENING, menu=MENU, budget=allowed, diagnose=diagnose, display=display
        )
    if last is not None:
        write_report(last, out / REPORT, history(log))
    for number, step in enumerate(log.steps, 1):
        console.print(
            f"{number}. {step.plan}, {step.minutes:.1f} min, {step.why}: {step.sentence or step.outcome}",
            soft_wrap=True,
        )
    console.print(log.ended, soft_wrap=True)
    if last is not None:
        show(last, out, console)
    return last is not None


def history(log: Investigation) -> "InvestigationHistory":
    """Return the log in the form of the report."""
    runs = [
        RunOfInvestigation(step.plan, step.minutes, step.why, step.sentence or step.outcome)
        for step in log.steps
    ]
    return InvestigationHistory(runs, log.budget, log.ended)


def choose(
    finding: Finding, menu: Mapping[str, Programme], left: float, done: Collection[str]
) -> tuple[Offer | None, str]:
    """Return the plan to run next, or None, and the reason.

    ``left`` is the remaining budget (min), ``done`` are the plans so far. A run that is predicted to decide is made
    only once, because a repetition would not decide either. A run with a smaller BIC gap is repeated if a few runs are
    enough and fit into the budget.
    """
    if finding.verdict not in UNDECIDED:
        return None, f"a verdict was reached: {'suspected' if finding.suspected else finding.verdict}"
    if finding.verdict is Verdict.UNRESOLVED:
        near = " and ".join(suspect.effect for suspect in finding.suspects)
        return None, (
            "no cause passes every test, so there are no alternatives to separate"
            + (f"; best candidates: {near}" if near else "")
        )
    ranked, made = offers(finding, menu), Counter(done)
    alone = [offer for offer in ranked if offer.bic_gap >= LEAST_GAP and offer.plan not in done]
    for offer in alone:
        if offer.minutes <= left:
            return offer, f"to decide between {_causes_left(finding)}: {_promise(offer)}"
    for offer in ranked:
        several = ceil(LEAST_GAP / offer.bic_gap) if 0.0 < offer.bic_gap < LEAST_GAP else 0
        if several and made[offer.plan] + several <= REPEATS and several * offer.minutes <= left:
            return offer, (
                f"to decide between {_causes_left(finding)}: {_promise(offer)}, and {LEAST_GAP:g} after {several} "
                "such runs"
            )
    if not alone:
        why = f"no further run on the menu would decide between {_causes_left(finding)}"
        if ranked:
            best = ranked[0]
            why += (
                f": for the best one, {best.plan}, {_gap(best)} is expected in {best.minutes:.1f} of the {left:.1f} "
                f"min that are left, but {LEAST_GAP:g} is needed"
            )
        return None, why
    cheapest = min(alone, key=lambda offer: offer.minutes)
    return None, (
        f"the budget is spent: {left:.1f} min are left, and {cheapest.plan}, the shortest run that would decide "
        f"between {_causes_left(finding)}, takes {cheapest.minutes:.1f} min"
    )


def _promise(offer: Offer) -> str:
    return f"{_gap(offer)} is expected in {offer.minutes:.1f} min"


def _gap(offer: Offer) -> str:
    return f"a BIC gap of {offer.bic_gap:.{0 if offer.bic_gap >= LEAST_GAP else 1}f}"


def _causes_left(finding: Finding) -> str:
    names = dict.fromkeys([*finding.names, *(rival.effect for rival in finding.ambiguous_with)])
    return " and ".join(names) or "the causes that are left"


def investigate(
    session: Session,
    rig: "RigFile",
    out: Path,
    *,
    first: Programme,
    menu: Mapping[str, Programme],
    budget: float,
    diagnose: Callable[[Sequence[Path]], Finding],
    display: ProgressDisplay,
) -> Investigation:
    """Run ``first``, diagnose, and continue with the plan that decides most per minute, within the budget (min).

    ``diagnose`` gets the directories of all records so far. The log is written after every run and at the end, also
    after an error. Raises RecordError if the budget is too small for the first plan, or if a directory cannot be used.
    Errors of ``diagnose`` are not caught.
    """
    needed = lasts(first) / minutes
    if needed > budget:
        raise RecordError(
            f"budget = {budget:g} min, but {first.name} alone takes {needed:.1f} min of the bench; give a larger budget"
        )
    log = Investigation(rig=rig.name, budget=budget)
    log.write(out)
    try:
        with connected(session):
            log.ended = _decide(log, session, rig, out, first, menu, diagnose, display)
    except BaseException as error:
        log.ended = f"{type(error).__name__} {error}".rstrip()
        raise
    finally:
        log.write(out)
    return log


def _decide(
    log: Investigation,
    session: Session,
    rig: "RigFile",
    out: Path,
    first: Programme,
    menu: Mapping[str, Programme],
    diagnose: Callable[[Sequence[Path]], Finding],
    display: ProgressDisplay,
) -> str:
    """Run plans and diagnose their records until no useful run is left.

    Store each step in the ``log``; return the reason of the end.
    """
    records: list[Path] = []
    attempts = 0
    programme, why = first, "to see where the model is wrong"
    while True:
        display.say(f"{programme.name}: {why}")
        name = f"{len(log.steps) + 1:02d}-{programme.name}"
        result, directory = run_plan(programme_plan(programme), session, rig, out, name, display)
        step = InvestigationStep(
            plan=programme.name,
            why=why,
            record=directory.name,
            minutes=result.duration / minutes,
            outcome=result.verdict,
        )
        log.steps.append(step)
        log.write(out)
        # A failed check does not stop the loop: an error of the bench may be the cause in question.
        if result.verdict is Outcome.BLOCKED:
            blocked = f"{programme.name} {result.verdict}: {result.reason}"
            if not blocked_by_the_link(result):
                return blocked
            attempts += 1
            if attempts == ATTEMPTS:
                return f"{blocked} ({attempts} times in a row)"
            if lasts(programme) / minutes > log.budget - log.spent:
                return f"{blocked}; the budget is spent: {log.budget - log.spent:.1f} min are left"
            why = "repeated, because the link or this machine blocked it"
            continue
        attempts = 0
        records.append(directory)
        finding = _computed_while_connected(session, lambda: diagnose(records))
        log.steps[-1] = msgspec.structs.replace(
            step,
            verdict=finding.verdict,
            sentence=finding.sentence,
            causes=list(finding.names),
            rivals=[rival.effect for rival in finding.ambiguous_with],
        )
        offer, why = choose(finding, menu, log.budget - log.spent, [one.plan for one in log.steps])
        if offer is None:
            return why
        programme = menu[offer.plan]


def _computed_while_connected(session: Session, work: Callable[[], T]) -> T:
    """Return the result of ``work``.

    Meanwhile the connection is used, because a rig closes it after a minute without messages.
    """
    if session.virtual:
        return work()
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(work)
        while not future.done():
            session.bench.wait(KEEP_ALIVE)
        return future.result()
