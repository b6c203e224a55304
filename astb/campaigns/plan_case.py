"""One case of the bench: a plan on a virtual rig with parameters, effects, faults, seed, and a specimen."""

import re
from collections.abc import Iterable, Mapping
from functools import partial
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

import msgspec

from astb.campaigns.run import run_cases
from astb.rig_file import RigFile, Simulation
from bench_records.disk import NotKept

if TYPE_CHECKING:
    from bench_records.result import Result

#: The rig of a case; the case sets its own simulation.
RIG: Final = "campaign"
#: Characters that are replaced in keys, because a key is also the name of a folder.
NO_FILE_NAME: Final = re.compile(r"[^\w.%+-]")


class PlanCase(msgspec.Struct, frozen=True, kw_only=True):
    """One run of a plan in virtual time: the same case gives the same row, except for its duration."""

    plan: str
    values: dict[str, Any] = {}  #: parameters of the plan, as text
    specimen: str = "astb"  #: a name that `astb list specimens` lists, or the path of a TOML file
    simulation: Simulation = Simulation()  #: parameter set, change, effects, faults, seed, as in a rig file
    variant: str = ""  #: name of the variant of the rig
    files: tuple[str, ...] = ()  #: digests of the named files: a changed file makes another case

    @property
    def key(self) -> str:
        """The unique name of the case: readable, with a digest of its content."""
        digest = sha256(msgspec.json.encode(self, order="deterministic")).hexdigest()[:10]
        values = ",".join(f"{name}={NO_FILE_NAME.sub('', str(value))}" for name, value in self.values.items())
        return "/".join(
            filter(None, (self.plan, values, self.variant, f"seed {self.simulation.seed}", digest))
        )


def by_key(cases: Iterable[PlanCase]) -> dict[str, PlanCase]:
    """Return the cases by their keys, as `run_cases` takes them."""
    return {case.key: case for case in cases}


def facts(case: PlanCase) -> dict[str, Any]:
    """Return the columns that describe the case: plan, its values, variant, specimen, seed, and simulation."""
    return {
        "plan": case.plan,
        "values": {name: str(value) for name, value in case.values.items()},
        "variant": case.variant,
        "specimen": case.specimen,
        "seed": case.simulation.seed,
        "change": {name: str(value) for name, value in case.simulation.change.items()},
        "simulation": msgspec.json.encode(case.simulation, order="deterministic").decode(),
    }


def warm_up() -> None:
    """Import and compile what every case needs."""
    import drivers.cycle  # noqa: F401
    from astb.session import build_rig

    build_rig(Simulation())


def run_plan_case(case: PlanCase, records: str = "") -> dict[str, Any]:
    """Run the plan of ``case`` on its rig; return verdict, reason and checks.

    The record is written to a directory in ``records``, if given. An invalid plan, parameter, effect or specimen raises
    the error of `astb run`.
    """
    if records:
        from astb.run import new_directory

        # An attempt that was killed may have left half a record under the name.
        return _row(_run(case, new_directory(Path(records), case.key.replace("/", "-").replace(" ", ""))))
    with TemporaryDirectory(prefix="astb-case-") as directory:
        return _row(_run(case, Path(directory)))


def run_plan_cases(
    cases: Mapping[str, PlanCase], out: Path | str, *, records: Path | str | None = None, **how: Any
) -> list[dict[str, Any]]:
    """Run plans on virtual rigs, and store a row of each in ``out``; return the rows, in the order of the cases.

    ``records`` is the directory for the record of each run; without it no records are kept. ``how`` are further
    arguments of `run_cases`.
    """
    function = partial(run_plan_case, records=str(Path(records).resolve()) if records else "")
    return run_cases(function, cases, out, facts=facts, prepare=warm_up, **how)


def _run(case: PlanCase, directory: Path) -> "Result":
    from astb.api import find_plan
    from astb.run import connected, describe
    from astb.session import build_rig, virtual_session
    from test_plans.execution import BY_THE_RECORD, execute
    from test_plans.specimen import read_specimen

    plan = find_plan(case.plan)
    plan = plan.given(case.values) if case.values else plan
    specimen = read_specimen(case.specimen)
    rig = RigFile(RIG, time="virtual", simulation=case.simulation)
    with virtual_session(build_rig(case.simulation), case.simulation) as session, connected(session):
        result = execute(
            plan,
            session.bench,
            directory,
            meta=describe(session, rig),
            rig=rig.name,
            seed=session.seed,
            specimen=specimen,
        )
    if BY_THE_RECORD in result.reason:  # the rig did not cause it, and a stored verdict would be permanent
        raise NotKept(result.reason)
    return result


def _row(result: "Result") -> dict[str, Any]:
    """Return the columns of a row: verdict, its reason, and each check (SI) without the parts of its uncertainty.

    The parts have different names in each plan, so each would need a column.
    """
    checks = [msgspec.to_builtins(one) for one in result.checks]
    return {
        "verdict": str(result.verdict),
        "reason": result.reason,
        "checks": [{name: value for name, value in one.items() if name != "parts"} for one in checks],
        "lasted": result.duration,  # s of the bench's own time
    }
