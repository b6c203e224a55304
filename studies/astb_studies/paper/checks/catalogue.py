"""All checks in their order: the paper's claims first, each by its number, the plant's layer before the paper's."""

from collections.abc import Iterable
from typing import Final

from astb_studies.paper.checks import (
    conservation,
    displacement,
    frequency,
    gas,
    lateral,
    numerics,
    orifice,
    ride,
    roll,
    rubber,
    valves,
)
from astb_studies.paper.claims import CLAIMS, ClaimCheck

#: The files whose checks are listed: a new one takes its place here.
SUBJECTS: Final = (
    gas,
    conservation,
    orifice,
    lateral,
    displacement,
    roll,
    frequency,
    rubber,
    valves,
    ride,
    numerics,
)


def _sort_key(check: ClaimCheck) -> tuple[bool, int, bool]:
    return check.id[0] != "T", int(check.id[1:]), check.layer == "paper"


#: The order of every list of checks.
CHECKS: Final[tuple[ClaimCheck, ...]] = tuple(
    sorted((check for claim in CLAIMS for check in claim.checks.values()), key=_sort_key)
)


def select(ids: Iterable[str] | None = None) -> list[int]:
    """Return the places in `CHECKS` of the given ids, all of them for None; KeyError for an unknown id."""
    if ids is None:
        return list(range(len(CHECKS)))
    given = set(ids)
    unknown = given - {check.id for check in CHECKS}
    if unknown:
        raise KeyError(f"there is no check {sorted(unknown)[0]}; the checks are T1 to T11 and A01 to A30")
    return [place for place, check in enumerate(CHECKS) if check.id in given]
