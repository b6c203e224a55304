"""Past runs and diagnoses for the page: the index of the panel's folder, and pages made from it."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec
from starlette.routing import Route

from astb.panel import notes
from astb.panel.answers import answered
from astb.panel.commands import command, text_of
from astb.panel.runs import CannotDo
from astb.panel.specimens import FOLDER
from bench_protocol.input_limits import RESULT_BYTES, read_bounded
from bench_protocol.os_errors import reason
from bench_records.comparison import compare_runs
from bench_records.index import RunIndex
from bench_records.kept_pages import write_comparison, write_trends
from bench_records.layout import REPORT, RecordError
from bench_records.plot_data import PlotData
from bench_records.record import read
from bench_records.replay import replay_of
from bench_records.report import report_page
from bench_records.run_folder import Unfinished, open_run
from bench_records.trend import trend_of
from diagnosis.report.words import prose

if TYPE_CHECKING:
    from astb.panel.answers import Parts

FINDING: Final = "finding.json"
#: Folder of archived runs, which are not in the list.
ARCHIVE: Final = "archive"
#: Drawings that a page of trends has at most: each takes a tenth of a second to make.
TRENDS: Final = 60
#: Values for moving a run that are not names.
IN_ARCHIVE, OUT_OF_ARCHIVE = "/in", "/out"
_NAME: Final = re.compile(r"\w[\w .-]{0,58}[\w-]|\w")


class Diagnosis(msgspec.Struct, frozen=True, kw_only=True):
    """A diagnosis in the folder. ``written`` is ISO 8601 in UTC."""

    directory: str
    written: str
    verdict: str
    sentence: str
    simulator: str


def routes(parts: Parts) -> Sequence[Route]:
    """Return the routes of the views *runs* and *diagnoses*."""
    kept = Kept(parts.out)

    def moved(run: str, to: str) -> str:
        old, new = kept.move(run, to)
        parts.runs.moved(old, new)
        return new.relative_to(parts.out).as_posix()

    return [
        command(
            parts,
            "/api/kept/rename",
            lambda request, body: moved(text_of(body, "run"), text_of(body, "name")),
        ),
        command(parts, "/api/kept/archive", lambda request, body: moved(text_of(body, "run"), IN_ARCHIVE)),
        command(
            parts, "/api/kept/restore", lambda request, body: moved(text_of(body, "run"), OUT_OF_ARCHIVE)
        ),
        Route("/api/kept", answered(lambda request: kept.runs())),
        Route("/api/kept/checks", answered(lambda request: kept.checks(request.query_params["run"]))),
        Route("/api/kept/replay", answered(lambda request: kept.replay(request.query_params["run"]))),
        Route("/api/diagnoses", answered(lambda request: kept.diagnoses())),
        Route("/kept/report", answered(lambda request: kept.report(request.query_params["run"]))),
        Route(
            "/kept/compare",
            answered(lambda request: kept.comparison(request.query_params["a"], request.query_params["b"])),
        ),
        Route(
            "/kept/trend",
            answered(
                lambda request: kept.trend(
                    request.query_params["run"],
                    [
                        int(one)
                        for one in request.query_params.getlist("place") or request.query_params["place"]
                    ],
                )
            ),
        ),
        *notes.routes(parts, kept.known),
        Route("/kept/diagnosis", answered(lambda request: kept.diagnosis(request.query_params["of"]))),
    ]


class Kept:
    """The contents of a folder of runs at the time of the request.

    Raises RecordError for missing or unreadable runs.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def runs(self) -> dict[str, Any]:
        """Return all runs, the newest first, and the unreadable ones."""
        if not self._folder.is_dir():
            return {"folder": str(self._folder), "runs": [], "unreadable": {}}
        index = RunIndex(self._folder)
        return {
            "folder": str(self._folder),
            "runs": index.runs()[::-1],
            "unreadable": index.unreadable,
        }

    def checks(self, run: str) -> list[dict[str, Any]]:
        """Return the checks of a run. In each, ``place`` is its number, which `trend` accepts."""
        return [
            {
                "place": place,
                "phase": one.phase,
                "text": str(one),
                "verdict": one.verdict.value,
                "about": one.about,
            }
            for place, one in enumerate(open_run(self.known(run)).result.checks)
        ]

    def replay(self, run: str) -> dict[str, Any]:
        """Return the data of a run for the drawing of the bench. Its numbers are packed as in reports."""
        numbers = PlotData()
        told = replay_of(read(self.known(run)), numbers)
        if told is None:
            raise RecordError(f"{run} has no reading that the drawing of the bench shows; choose another run")
        return {"told": told, "packed": numbers.packed}

    def report(self, run: str) -> str:
        """Return the report of a run: the existing file, or one made now; nothing is written."""
        directory = self.known(run)
        if (path := directory / REPORT).exists():
            return path.read_text(encoding="utf-8")
        return report_page(directory)

    def comparison(self, a: str, b: str) -> str:
        """Return the page of two runs next to each other."""
        found = compare_runs(self.known(a), self.known(b))
        return _page(lambda path: write_comparison(found, path))

    def trend(self, run: str, places: Sequence[int]) -> str:
        """Return the page of some checks of a run, over all runs of its specimen that were made in the same way."""
        checks = open_run(self.known(run)).result.checks
        index = RunIndex(self._folder)
        known = next(one for one in index.runs() if one.directory == run)
        if not 0 < len(places) <= TRENDS:
            raise RecordError(f"{len(places)} trends are requested, but a page shows 1 to {TRENDS}")
        for place in places:
            if not 0 <= place < len(checks):
                raise RecordError(
                    f"{run} has {len(checks)} checks, so there is no check {place + 1}; reload the page"
                )
        like = {name: getattr(known, name) for name in ("plan", "rig", "circumstances", "serial_number")}
        trends = [
            trend_of(
                checks[place].name,
                [
                    one
                    for one in index.checks(checks[place].name, **like)
                    if one.phase == checks[place].phase and one.run.parameters == known.parameters
                ],
            )
            for place in dict.fromkeys(places)
        ]
        return _page(lambda path: write_trends(trends, known.serial_number, path))

    def diagnoses(self) -> list[Diagnosis]:
        """Return the diagnoses in the folder, the newest first; other folders are left out."""
        found = []
        for path in self._folder.rglob(FINDING):
            try:
                content = msgspec.json.decode(read_bounded(path, RESULT_BYTES), type=dict[str, Any])
                written = datetime.fromtimestamp(path.stat().st_mtime, UTC)
                found.append(
                    Diagnosis(
                        directory=path.parent.relative_to(self._folder).as_posix(),
                        written=written.strftime("%Y-%m-%dT%H:%M:%SZ"),
                        verdict=str(content["verdict"]),
                        sentence=prose(str(content["sentence"])),
                        simulator=str(content["provenance"]["simulator"]),
                    )
                )
            except (OSError, ValueError, KeyError, TypeError, RecursionError):
                continue
        return sorted(found, key=lambda one: one.written, reverse=True)

    def diagnosis(self, of: str) -> str:
        """Return the report of a diagnosis."""
        if of not in [one.directory for one in self.diagnoses()]:
            raise RecordError(
                f"{self._folder} holds no diagnosis {of}; reload the page to see the present ones"
            )
        try:
            return (self._folder / of / REPORT).read_text(encoding="utf-8")
        except OSError as error:
            raise RecordError(f"{REPORT} of {of} cannot be read: {reason(error)}") from None

    def move(self, run: str, to: str) -> tuple[Path, Path]:
        """Rename the folder of a run, or move it to the archive or back; return the old and the new path.

        Its files do not change, so that signatures stay valid. Raises CannotDo for a run in progress, and for an
        invalid or existing name.
        """
        known = {one.directory: one for one in RunIndex(self._folder).runs()}
        if run not in known:
            raise CannotDo(f"{self._folder} holds no run {run!r}; reload the page")
        if known[run].verdict == Unfinished.RUNNING:
            raise CannotDo(f"{run} is still running: wait for its end")
        old = self._folder / run
        if to == IN_ARCHIVE:
            new = self._folder / ARCHIVE / run
        elif to == OUT_OF_ARCHIVE:
            new = self._folder / Path(run).relative_to(ARCHIVE) if Path(run).parts[0] == ARCHIVE else old
        elif not _NAME.fullmatch(to) or to in (ARCHIVE, FOLDER):
            raise CannotDo(
                f"{to!r} is not a valid name for a run; use up to sixty letters, digits, spaces and - _ ."
            )
        else:
            new = old.with_name(to)
        if new == old:
            return old, new
        if new.exists():
            raise CannotDo(f"{new.relative_to(self._folder)} exists already; choose another name")
        try:
            new.parent.mkdir(parents=True, exist_ok=True)
            old.rename(new)
        except OSError as error:
            raise CannotDo(f"{run} cannot be moved: {reason(error)}") from None
        return old, new

    def known(self, run: str) -> Path:
        """Return the directory of a run in the index.

        Raises RecordError for another name, so that no other directory is opened.
        """
        if run not in [one.directory for one in RunIndex(self._folder).runs()]:
            raise RecordError(f"{self._folder} holds no run {run}; reload the page")
        return self._folder / run


def _page(write: Callable[[Path], None]) -> str:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "page.html"
        write(path)
        return path.read_text(encoding="utf-8")
