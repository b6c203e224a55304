"""Specimens for the page: those of the bench, and files from users, which are checked first."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

from starlette.routing import Route

from astb.panel.answers import answered
from astb.panel.commands import command, text_of
from astb.panel.runs import CannotDo
from bench_protocol.input_limits import parse_toml, read_bounded
from bench_protocol.named_files import place_of
from bench_protocol.units import kN
from bench_records.disk import kept
from bench_records.layout import RecordError
from bench_records.typography import MINUS
from bench_records.typography import unit as as_written
from test_plans.loads import SpecimenError
from test_plans.specimen import ORDINARY, PACKAGE, Specimen, packaged, read_specimen

if TYPE_CHECKING:
    from astb.panel.answers import Parts

#: Folder of the uploaded files, in the folder of the runs.
FOLDER: Final = "specimens"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,59}\.toml")


def routes(parts: Parts) -> Sequence[Route]:
    """Return the routes of the view *specimens*."""
    known = Specimens(parts.out)
    return [
        Route("/api/specimens", answered(lambda request: known.listed())),
        Route("/api/specimens/one", answered(lambda request: known.content(request.query_params["name"]))),
        command(
            parts,
            "/api/specimens/add",
            lambda request, body: known.add(
                text_of(body, "name"), text_of(body, "text"), instead=body.get("instead") is True
            ),
        ),
    ]


class Specimens:
    """The specimens by name. A user's specimen has the name of its file, which ends in .toml."""

    def __init__(self, out: Path) -> None:
        self._folder = out / FOLDER

    def names(self) -> list[str]:
        """Return the names, those of the bench first."""
        own = (one.name for one in self._folder.glob("*.toml")) if self._folder.is_dir() else ()
        return [*packaged(), *sorted(own)]

    def place(self, name: str) -> str:
        """Return the argument for `astb run --specimen`, "" for "". Raises CannotDo for a name that is not listed."""
        if name and name not in self.names():
            raise CannotDo(f"there is no specimen {name!r}; the specimens are {', '.join(self.names())}")
        return str((self._folder / name).resolve()) if name.endswith(".toml") else name

    def read(self, name: str) -> Specimen:
        """Return a specimen, by default that of the bench.

        Raises CannotDo, with the message of the reader, for an invalid file.
        """
        try:
            return read_specimen(self.place(name) or ORDINARY)
        except SpecimenError as error:
            raise CannotDo(str(error)) from None

    def listed(self) -> list[dict[str, Any]]:
        """Return the facts of each specimen, or its errors."""
        return [self._facts(name) for name in self.names()]

    def content(self, name: str) -> dict[str, Any]:
        """Return the content of a file: its rows with value or limits, unit, provenance and source."""
        try:
            path = Path(self.place(name)) if name.endswith(".toml") else place_of(PACKAGE, name)
            content = parse_toml(read_bounded(path))
        except (CannotDo, OSError, ValueError) as error:
            raise RecordError(str(error)) from None
        return self._facts(name) | {"rows": list(_rows(content))}

    def add(self, name: str, text: str, *, instead: bool = False) -> str:
        """Store a user's file; return its name. With ``instead``, it may replace a file with other contents.

        Raises CannotDo, and stores nothing, if it is not a valid specimen or must not replace a file.
        """
        if not _NAME.fullmatch(name):
            raise CannotDo(
                f"{name!r} is not a valid name for the file of a specimen; use a name such as mine.toml"
            )
        with TemporaryDirectory() as directory:
            path = Path(directory) / name
            path.write_text(text, encoding="utf-8", newline="\n")
            try:
                read_specimen(path)
            except SpecimenError as error:
                raise CannotDo(str(error).replace(str(path), name)) from None
        place = self._folder / name
        if place.exists() and place.read_text(encoding="utf-8") != text and not instead:
            raise CannotDo(
                f"{name} exists already with other contents; choose another name, or replace the file"
            )
        try:
            with kept(place):
                self._folder.mkdir(parents=True, exist_ok=True)
                place.write_text(text, encoding="utf-8", newline="\n")
        except RecordError as error:
            raise CannotDo(str(error)) from None
        return name

    def _facts(self, name: str) -> dict[str, Any]:
        own = name.endswith(".toml")
        try:
            one = self.read(name)
        except CannotDo as error:
            return {"name": name, "own": own, "error": str(error)}
        loads = {load.name: f"{load.preload / kN:g} kN" for load in one.loads.values()}
        return {"name": name, "own": own, "error": "", "loads": loads, **one.facts}


def _rows(table: Mapping[str, Any], where: str = "") -> Iterator[dict[str, str]]:
    """Yield a row for each value and limit in the file of a specimen, in the unit of the file."""
    for key, entry in table.items():
        name = f"{where}{key}"
        if isinstance(entry, dict) and "unit" in entry:
            yield {
                "name": name.replace("_", " "),
                "says": _value_text(entry),
                "provenance": str(entry["provenance"]),
                "source": str(entry["source"]),
            }
        elif isinstance(entry, dict):
            yield from _rows(entry, f"{name} › ")


def _value_text(entry: Mapping[str, Any]) -> str:
    return _in_figures(entry).replace("-", MINUS)


def _in_figures(entry: Mapping[str, Any]) -> str:
    unit = "" if entry["unit"] == "1" else f" {as_written(entry['unit'])}"
    if "value" in entry:
        return f"{entry['value']:g}{unit}"
    if "expected" in entry:
        around = f"{unit} ± {100 * entry['tolerance']:g} %"
        if not isinstance(entry["expected"], list):
            return f"{entry['expected']:g}{around}"
        (over,) = entry.keys() - {"expected", "tolerance", "unit", "provenance", "source"}
        what, _, of = over.partition("_")
        at = ", ".join(f"{place:g}" for place in entry[over])
        return f"{', '.join(f'{one:g}' for one in entry['expected'])}{around}, at {what} {at} {of or 'Hz'}"
    if "low" in entry and "high" in entry:
        return f"{entry['low']:g} to {entry['high']:g}{unit}"
    return f"at least {entry['low']:g}{unit}" if "low" in entry else f"at most {entry['high']:g}{unit}"
