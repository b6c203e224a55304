"""A campaign file: the TOML that states which plans run with which parameters, specimens, rigs and seeds."""

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from astb.api import find_plan
from astb.campaigns.plan_case import PlanCase, by_key
from astb.rig_file import SEED_MAX, FaultEntry, RigFileError, Simulation, find_rig
from astb.session import build_rig
from bench_protocol.input_limits import read_toml
from bench_protocol.misfit import misfit
from bench_protocol.os_errors import file_errors
from test_plans.run import PlanError
from test_plans.specimen import read_specimen

Seed = Annotated[int, Meta(ge=0, le=SEED_MAX)]


class CampaignError(ValueError):
    """A campaign file that cannot be run; the text states how to correct it."""


class Variant(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Changes to the simulation of the rig file, with a name."""

    name: str
    parameters: str = ""  #: name of a parameter set, or the path of its TOML file
    change: dict[str, Any] = {}
    effects: dict[str, Any] = {}
    faults: tuple[FaultEntry, ...] = ()


class CampaignFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Content of a campaign file.

    Each plan runs with each combination of values, specimen, variant, change and seed.
    """

    plans: Annotated[tuple[str, ...], Meta(min_length=1)]
    seeds: Annotated[int, Meta(ge=1)] | Annotated[tuple[Seed, ...], Meta(min_length=1)] = (
        1  #: number of seeds from the first on, or a list of seeds
    )
    specimens: Annotated[tuple[str, ...], Meta(min_length=1)] = ("astb",)
    rig: str = ""  #: path of a rig file or its name; its simulation is the base of all cases
    values: dict[str, Any] = {}  #: of the plans; a table with the name of a plan is for that plan alone
    change: dict[str, Any] = {}  #: parameters of the rig
    variants: tuple[Variant, ...] = ()


def read_campaign(path: Path) -> dict[str, PlanCase]:
    """Return the cases of a campaign file by their keys. All cases are checked before any of them runs.

    In ``values`` and ``change`` each entry of a list is a case. Paths are relative to the directory of the campaign
    file. Raises CampaignError with file, key and the correct form.
    """
    with file_errors(f"campaign file {path}", CampaignError):
        content = read_toml(path)
    try:
        campaign = msgspec.convert(content, CampaignFile)
    except msgspec.ValidationError as error:
        raise CampaignError(f"campaign file {path}: {misfit(error, content, CampaignFile)}") from None
    try:
        return by_key(_checked(list(_combined(campaign, path.parent))))
    except CampaignError as error:
        raise CampaignError(f"campaign file {path}: {error}") from None


def _combined(campaign: CampaignFile, home: Path) -> Iterator[PlanCase]:
    seeds = range(campaign.seeds) if isinstance(campaign.seeds, int) else campaign.seeds
    specimens = [_path(name, home) for name in campaign.specimens]
    base = _base(campaign.rig, home)
    for name in campaign.values:
        if isinstance(campaign.values[name], dict) and name not in campaign.plans:
            raise CampaignError(
                f"values.{name} is for a plan that is not in plans; add the plan, or remove the values"
            )
    for plan in campaign.plans:
        own = _values_for_plan(plan, campaign.values)
        for values, specimen, variant, change, seed in product(
            _choices(own), specimens, campaign.variants or (Variant(""),), _choices(campaign.change), seeds
        ):
            yield PlanCase(
                plan=plan,
                values=values,
                specimen=specimen,
                variant=variant.name,
                simulation=replace(
                    base,
                    parameters=_path(variant.parameters, home) or base.parameters,
                    change=base.change | change | variant.change,
                    effects=base.effects | variant.effects,
                    faults=(*base.faults, *variant.faults),
                    seed=seed,
                ),
            )


def _base(rig: str, home: Path) -> Simulation:
    if not rig:
        return Simulation()
    try:
        path = home / rig if rig.endswith(".toml") or (home / rig).is_file() else rig
        simulation = find_rig(path)[0].simulation
    except RigFileError as error:
        raise CampaignError(str(error)) from None
    if simulation is None:
        raise CampaignError(
            f"rig = {rig!r} is a real rig; a campaign needs a rig file with a [simulation] table"
        )
    return simulation


def _path(name: str, home: Path) -> str:
    """Return the path of a TOML file as an absolute path, because workers may run in another directory.

    Names are unchanged.
    """
    return str((home / name).resolve()) if name.endswith(".toml") else name


def _values_for_plan(plan: str, values: Mapping[str, Any]) -> dict[str, Any]:
    for_all = {name: value for name, value in values.items() if not isinstance(value, dict)}
    return for_all | values.get(plan, {})


def _choices(given: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield every combination of the values in lists, by name. A value that is not a list is in every combination."""
    lists = [value if isinstance(value, list) else [value] for value in given.values()]
    for chosen in product(*lists):
        yield dict(zip(given, chosen, strict=True))


def _checked(cases: list[PlanCase]) -> list[PlanCase]:
    """Return the cases with the digests of their files. Raises CampaignError for a case that cannot run."""
    known: dict[Any, str] = {}

    def once(key: Any, look: Any) -> str:
        if key not in known:
            try:
                known[key] = str(look())
            except (ValueError, PlanError) as error:
                raise CampaignError(str(error)) from None
        return known[key]

    done = []
    for case in cases:
        rig = replace(case.simulation, seed=0)
        once(
            ("plan", case.plan, str(case.values)),
            lambda case=case: find_plan(case.plan).given(case.values).name,
        )
        files = (
            once(("specimen", case.specimen), lambda case=case: read_specimen(case.specimen).facts["sha256"]),
            once(("rig", str(rig)), lambda rig=rig: build_rig(rig).parameters.digest()),
        )
        done.append(replace(case, files=files))
    return done
