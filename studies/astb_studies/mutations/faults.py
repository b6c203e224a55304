"""The mutation matrix: faults of ordinary size in every plan with checks, and whether the right check failed."""

import csv
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from astb.campaigns.findings import FAILED
from astb.rig_file import FaultEntry, Simulation

HERE: Final = Path(__file__).parent
TABLE: Final = HERE / "mutations.toml"
FOUND: Final = HERE / "mutations.csv"
#: Name of the rig without a fault.
SOUND: Final = "sound"
#: Seed of sensors and noise. It is equal in all cases, so that only the fault causes a difference from the sound rig.
SEED: Final = 0

Kind = Literal["plant", "sensor", "wire"]
#: By a check that is meant for it; by another one; not at all.
Found = Literal["caught", "wrong reason", "missed"]

_ABOUT_A_SIDE: Final = re.compile(
    r"\b(left|right) (?:spring|bellows|valve|vertical|cells|stiffness|damping|K'|c\b)"
)


class Mutation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A fault of ordinary size, and the checks that should fail; declared before any plan was run."""

    name: str
    what: str  #: in words
    kind: Kind
    change: dict[str, Any] = {}  #: of parameters, as in a rig file
    effects: dict[str, str] = {}
    faults: tuple[FaultEntry, ...] = ()
    right: tuple[str, ...]  #: names of reasons
    side: str = ""  #: left or right, where checks of the other spring are no right reason
    missed: str = ""  #: if no plan detects it: the reason, and a test that would

    @property
    def simulation(self) -> Simulation:
        """The simulation with this fault."""
        return Simulation(seed=SEED, change=self.change, effects=self.effects, faults=self.faults)


class Mutations(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All mutations, and their reasons: patterns for names of checks, in which * matches any text."""

    reasons: dict[str, tuple[str, ...]]
    mutation: tuple[Mutation, ...]

    def is_right(self, one: Mutation, text: str) -> bool:
        """Whether ``text``, the name of a failed check or the reason of a blocked run, is right for this fault."""
        about = _ABOUT_A_SIDE.search(text)
        if one.side and about and about[1] != one.side:
            return False
        return any(fnmatchcase(text, pattern) for name in one.right for pattern in self.reasons[name])


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one plan with one fault."""

    mutation: str
    plan: str
    found: Found
    verdict: str
    told: str  #: failed checks, or why the run was blocked; right reasons first
    nearest: str  #: the check whose value moved furthest from the sound rig toward its limit
    used: float  #: part of the distance to the limit (1: at the limit)
    version: str = ""  #: of the code: commit and day


@cache
def mutations() -> Mutations:
    """Return the table of faults. Raises msgspec.ValidationError, with its place, for an invalid row."""
    return msgspec.convert(tomllib.loads(TABLE.read_text(encoding="utf-8")), Mutations)


def judge(table: Mutations, one: Mutation, row: Mapping[str, Any], sound: Mapping[str, Any]) -> Cell:
    """Return the cell of a plan on a rig with this fault, from its row and the row of the sound rig."""
    messages = [check["name"] for check in row["checks"] or () if check["verdict"] in FAILED]
    if row["verdict"] == "blocked":
        messages.append(f"blocked: {row['reason']}")
    right = [name for name in messages if table.is_right(one, name)]
    found: Found = "missed"
    if row["verdict"] in ("fail", "blocked"):
        found = "caught" if right else "wrong reason"
    nearest, used = _nearest(row["checks"] or (), sound["checks"] or ())
    messages = right + [name for name in messages if name not in right]
    return Cell(
        mutation=one.name,
        plan=row["plan"],
        found=found,
        verdict=row["verdict"],
        told="; ".join(messages),
        nearest=nearest,
        used=round(used, 2),
        version=row.get("version", ""),
    )


def _nearest(checks: Sequence[Mapping[str, Any]], sound: Sequence[Mapping[str, Any]]) -> tuple[str, float]:
    """Return the check with the largest relative change from the fault-free value toward a limit, and this change."""
    before = {check["name"]: check["value"] for check in sound}
    ways = [("", 0.0)]
    for check in checks:
        was, now = before.get(check["name"]), check["value"]
        if was is None or now is None or not (isfinite(was) and isfinite(now)):
            continue
        limit = check["high"] if now > was else check["low"]
        if limit is not None and limit != was:
            ways.append((check["name"], (now - was) / (limit - was)))
    return max(ways, key=lambda way: way[1])


def write_cells(path: Path, cells: Iterable[Cell]) -> None:
    """Write the matrix, in the order of ``cells``."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Cell.__struct_fields__)
        writer.writerows(msgspec.structs.astuple(cell) for cell in cells)


def read_cells(path: Path = FOUND) -> list[Cell]:
    """Return the stored matrix."""
    with path.open(encoding="utf-8", newline="") as file:
        return [msgspec.convert(row, Cell, strict=False) for row in csv.DictReader(file)]
