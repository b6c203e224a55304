"""Each package has its room among the tests; what else lies there tests the whole, and is named here."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Rooms of no one package, and those of packages inside others; CONTRIBUTING.md names their subjects.
WHOLE = {"contracts", "foreign", "fuzz", "system", "wheel", "wires"}
INNER = {"acceptance", "campaigns", "fmu", "panel", "twin"}


def rooms_of(package: str) -> set[str]:
    """Return the rooms of a package: its name, without what several names have."""
    return {"model", "rig"} if package == "bench_sim" else {re.sub(r"^(bench|test)_", "", package)}


def test_the_rooms_are_those_of_the_packages_and_of_the_whole() -> None:
    packages = [init.parent.name for init in ROOT.glob("*/__init__.py")]
    assert len(packages) == 7
    assert {path.parent.name for path in (ROOT / "tests").glob("*/*.py")} == WHOLE.union(
        INNER, *map(rooms_of, packages)
    )


def test_the_guide_lists_test_folders_without_a_package_name() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    told = page.partition("\n## Tests\n")[2].partition("\n## ")[0]
    assert [room for room in sorted(WHOLE | rooms_of("bench_sim")) if f"`{room}`" not in told] == []
