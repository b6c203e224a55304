"""Each package has its room among the tests; what else lies there tests the whole, and is named here."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Rooms of no one package; CONTRIBUTING.md says of what.
WHOLE = {"contracts", "foreign", "fuzz", "system", "wheel", "wires"}


def rooms_of(package: str) -> set[str]:
    """Return the rooms of a package: its name, less what many names have."""
    return {"model", "rig"} if package == "bench_sim" else {re.sub(r"^(bench|test)_|_study$", "", package)}


def test_the_rooms_are_those_of_the_packages_and_of_the_whole() -> None:
    packages = [init.parent.name for init in ROOT.glob("*/__init__.py")]
    wanted = WHOLE.union(rooms_of("benchmarks"), *map(rooms_of, packages))
    assert len(packages) > 10
    assert {path.parent.name for path in (ROOT / "tests").glob("*/*.py")} == wanted


def test_contributors_are_told_of_rooms_that_have_no_packages_name() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    told = page.partition("\n## Tests\n")[2].partition("\n## ")[0]
    assert [room for room in sorted(WHOLE | rooms_of("bench_sim")) if f"`{room}`" not in told] == []
