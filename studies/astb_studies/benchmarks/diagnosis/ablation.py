"""``python -m astb_studies.benchmarks.diagnosis.ablation``: switch off each rule of the diagnosis alone, and count.

Theory of operation ------------------- A rule is a function of the engine whose result is neutral in most cases: no
effect removed, no further trial. Each case is diagnosed once with all rules. During this, each rule is observed: it
*acts* if its result is not the neutral one. If it did not act, the diagnosis without the rule would be the same
computation. So only the cases in which it acted are diagnosed again, each without this one rule. The comparison of both
is paired: the same specimen, noise and seed.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import Any, Final

import click
import msgspec
from scipy.stats import binomtest

from astb_studies.benchmarks.diagnosis.campaign import COUNTED, Case, carry_out, cases, siblings
from astb_studies.benchmarks.diagnosis.judge import CLEAR, Judged
from astb_studies.benchmarks.diagnosis.statistics import Rate
from diagnosis.engine import diagnose, gates, rivals
from diagnosis.engine.fitting.predict import predict

#: Seeds of the ablation begin here: no rule was chosen by these cases.
FIRST_SEED: Final = 31_000_000
#: The package of all rules; `diagnose` has imported each of its modules.
ENGINE: Final = diagnose.__package__
KEPT: Final = COUNTED / "ablation.jsonl"


@dataclass(frozen=True)
class Rule:
    """A rule of the engine: its function, its result when it does nothing, and whether a result differs from that."""

    name: str
    module: str
    function: str
    off: Callable[..., Any]
    acted: Callable[..., bool] = lambda result, *_args: bool(result)

    @property
    def original(self) -> Callable[..., Any]:
        """The function in the engine."""
        return getattr(import_module(f".{self.module}", ENGINE), self.function)

    @contextmanager
    def replaced(self, by: Callable[..., Any]) -> Iterator[None]:
        """Put another function in the place of the rule, in every module that imported it."""
        original = self.original
        places = [
            (module, name)
            for module in list(sys.modules.values())
            if module.__name__.startswith("diagnosis.")
            for name, value in list(vars(module).items())
            if value is original
        ]
        for module, name in places:
            setattr(module, name, by)
        try:
            yield
        finally:
            for module, name in places:
                setattr(module, name, original)


def _first(first: Any, *_others: Any) -> Any:
    return first


def _differs_from_first(result: Any, first: Any, *_others: Any) -> bool:
    return result is not first


def _without_swaps(problem: Any, state: Any) -> Any:
    return replace(state, rivals={old: rivals._rivals(problem, state, old) for old in state.current.effects})


def _swapped(result: Any, _problem: Any, state: Any) -> bool:
    return set(result.current.effects) != set(state.current.effects)


def _only_explained(*args: Any) -> str:
    return gates.explains_too_little(*args)


def _as_judged(judgement: Any, runs: Any, _config: Any) -> Any:
    return judgement, predict(judgement.model, runs, fixed=True)


def _first_that_passes(_problem: Any, _state: Any, trials: Sequence[Any]) -> Any:
    return next((trial for trial in trials if not trial.failed), None)


def _always(result: Any) -> Callable[..., Any]:
    """Return a function that returns ``result`` for any arguments."""
    return lambda *_args, **_named: result


def _is_something(result: Any, *_args: Any) -> bool:
    return result is not None


#: The rules beyond score, threshold, fit and BIC, in the order of the steps of a diagnosis.
RULES: Final = (
    Rule("unphysical", "gates", "unphysical", _always("")),
    Rule("merely rough", "gates", "merely_rough", _always("")),
    Rule(
        "density of the validation runs",
        "gates",
        "useless",
        _only_explained,
        lambda result, *args: result != _only_explained(*args),
    ),
    Rule("explains too little", "gates", "explains_too_little", _always("")),
    Rule("surcharge of a richer member", "family", "richer_surcharge", _always(0.0)),
    Rule(
        "richer member instead of a pair",
        "admission",
        "choose",
        _first_that_passes,
        lambda result, *args: result is not _first_that_passes(*args),
    ),
    Rule("small but sufficient", "admission", "choose_sufficient", _always(None), _is_something),
    Rule("with a strained trial", "admission", "choose_with_strained", _always(None), _is_something),
    Rule("finite sizes", "finite_sizes", "try_finite_sizes", _always(())),
    Rule("swap", "rivals", "swap", _without_swaps, _swapped),
    Rule("backward elimination", "backward", "_failed", _always({})),
    Rule(
        "remove the weaker of two",
        "backward",
        "_one_too_many",
        lambda _problem, _state, _without, failed: failed,
        lambda result, _problem, _state, _without, failed: result != failed,
    ),
    Rule("below the resolution of samples", "verdict", "_below_samples", _always({})),
    Rule("surface instead of a cause", "cause_removal", "doubtful", _always(())),
    Rule("not clearly larger than a surface", "cause_removal", "no_clearer", _always(())),
    Rule("interval contains zero", "cause_removal", "vague", _always(())),
    Rule("constancy", "constancy", "owed_to_form", _always(())),
    Rule("exemption of predicted causes", "prediction_share", "is_predicted", _always(False)),
    Rule(
        "removed causes again",
        "displaced",
        "without_substitutes",
        lambda _problem, first: first,
        lambda result, _problem, first: result is not first,
    ),
    Rule(
        "surfaces that predict worse",
        "diagnose",
        "_worthwhile",
        _as_judged,
        lambda result, judgement, *_: result[0] is not judgement,
    ),
    Rule("rivals by unseen runs", "rivals_unseen", "undecided", _always(())),
    Rule("verdict by unseen runs", "verdict", "final", _first, _differs_from_first),
    Rule("goodness of fit", "diagnose", "verdict_on", _first, _differs_from_first),
    Rule(
        "laws of one phenomenon",
        "equivalence_classes",
        "indistinguishable_laws",
        lambda found, *_: {one.effect: [] for one in found.accepted},
        lambda result, *_: any(result.values()),
    ),
)


_INTRODUCTION: Final = f"""## Rules switched off

Each case was diagnosed with all rules, and again without each rule that acted in it, one rule at a time. "3 / 1" means:
three cases are better with the rule, and one is better without it. *Exact* and *reported* count clear effects (λ of
{CLEAR:g} or more) on systems of the model's form. *False names* count wrong causes, and all causes of a sibling
without an effect. p is the smallest of three sign tests. A rule that acted in none of n cases changes at most 3/n of
all cases (95 %). The cases were drawn after the rules were chosen: their seeds begin at {FIRST_SEED}, counted on
2026-11-29. Rules for measured actuators and for rigs with several causes seldom act on an oscillator, so this table
alone is no reason to remove one.
"""


class Outcome(msgspec.Struct, frozen=True):
    """The counted results of a judgement; None if a rate does not apply."""

    exact: bool | None
    reported: bool | None
    false: bool


class Ablated(msgspec.Struct, frozen=True, kw_only=True):
    """A case: its outcome with all rules, and without each rule that acted, by the rule's name."""

    system: str
    kind: str
    condition: str
    seed: int
    outcome: Outcome
    without: dict[str, Outcome]


def outcome(judged: Judged) -> Outcome:
    """Return the counted results of a judgement: exact and reported for effects with a clear λ, false for each case."""
    of_catalogue = judged.kind not in {"null", "outside"}
    clear = of_catalogue and judged.weakest >= CLEAR and judged.condition != "sibling"
    accused = bool(judged.causes) if judged.condition == "sibling" else judged.detected
    return Outcome(
        (judged.exact or judged.in_family) if clear else None,
        judged.reported if clear else None,
        accused if judged.kind == "null" else bool(judged.wrong),
    )


def ablate(case: Case) -> Ablated:
    """Diagnose a case with all rules, then without each rule that acted.

    Raises RuntimeError if there is no finding.
    """
    acted: set[str] = set()

    def observed(rule: Rule, original: Callable[..., Any], *args: Any, **named: Any) -> Any:
        result = original(*args, **named)
        if rule.acted(result, *args):
            acted.add(rule.name)
        return result

    with ExitStack() as stack:
        for rule in RULES:
            stack.enter_context(rule.replaced(partial(observed, rule, rule.original)))
        with_all = _outcome(case)
    without = {}
    for rule in RULES:
        if rule.name in acted:
            with rule.replaced(rule.off):
                without[rule.name] = _outcome(case)
    return Ablated(
        system=case.system,
        kind=case.kind,
        condition=case.condition,
        seed=case.seed,
        outcome=with_all,
        without=without,
    )


def _outcome(case: Case) -> Outcome:
    judged = carry_out(case)
    if judged.failure:
        raise RuntimeError(f"{case}: {judged.failure}")
    return outcome(judged)


def kept() -> list[Ablated]:
    """Return the kept cases."""
    lines = KEPT.read_bytes().splitlines() if KEPT.exists() else []
    return [msgspec.json.decode(line, type=Ablated) for line in lines]


def table(ablated: Sequence[Ablated]) -> list[str]:
    """Return a row for each rule: in how many cases it acted, and which outcomes differ without it.

    A pair "3 / 1" is: three cases are better with the rule, one is better without it. p is that of the sign test.
    """
    lines = [
        "| rule | acted | exact: better with / without | reported | false names | p, least of the three |",
        "|---|---|---|---|---|---|",
    ]
    for rule in RULES:
        pairs = [(one.outcome, one.without[rule.name]) for one in ablated if rule.name in one.without]
        cells, least = [], 1.0
        for name, sign in (("exact", 1), ("reported", 1), ("false", -1)):
            steps = [sign * ((getattr(a, name) or 0) - (getattr(b, name) or 0)) for a, b in pairs]
            better, worse = sum(step > 0 for step in steps), sum(step < 0 for step in steps)
            cells.append(f"{better} / {worse}" if better or worse else "0")
            if better + worse:
                least = min(least, float(binomtest(better, better + worse).pvalue))
        lines.append(f"| {rule.name} | {len(pairs)} | {' | '.join(cells)} | {least:.2g} |")
    return lines


def _rates(ablated: Sequence[Ablated]) -> str:
    clear = [one.outcome for one in ablated if one.outcome.exact is not None]
    forms = [one.outcome.false for one in ablated if one.condition == "sibling"]
    others = [one.outcome.false for one in ablated if one.condition != "sibling"]
    return (
        f"With all rules: exact {Rate.of([bool(one.exact) for one in clear])}, reported "
        f"{Rate.of([bool(one.reported) for one in clear])} of {len(clear)} clear cases; false names "
        f"{Rate.of(others)} of {len(others)}, on siblings {Rate.of(forms)} of {len(forms)}."
    )


def section() -> list[str]:
    """Return the section of the page of rates."""
    lines = [_INTRODUCTION]
    for system in ("oscillator", "bench"):
        if ablated := [one for one in kept() if one.system == system]:
            lines += [
                f"### Rules on the {system}: {len(ablated)} cases",
                "",
                _rates(ablated),
                "",
                *table(ablated),
                "",
            ]
    return lines


@click.command()
@click.option("--system", type=click.Choice(("oscillator", "bench")), default="oscillator", show_default=True)
@click.option("--cases", "count", default=400, show_default=True, help="Cases of all kinds.")
@click.option("--siblings", "others", default=200, show_default=True, help="Cases of another model form.")
@click.option("--first", default=0, show_default=True, help="Skip so many cases of each.")
def main(system: str, count: int, others: int, first: int) -> None:
    """Carry out the remaining cases, and print the table."""
    known = {(one.system, one.kind, one.condition, one.seed) for one in kept()}
    planned = (*cases(system, count)[first:], *siblings(system, others)[first:])
    for case in (msgspec.structs.replace(one, seed=one.seed + FIRST_SEED) for one in planned):
        if (case.system, case.kind, case.condition, case.seed) in known:
            continue
        with KEPT.open("ab") as file:
            file.write(msgspec.json.encode(ablate(case)) + b"\n")
    print(*section(), sep="\n")


if __name__ == "__main__":
    main()
