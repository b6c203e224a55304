"""Rehearsals for the page: `astb rehearse` in its own process, in virtual time, without any rig."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any, Final

from starlette.routing import Route

from astb.panel.access import NotAllowed
from astb.panel.answers import answered
from astb.panel.commands import command, settings_of, text_of
from astb.panel.kept import Kept
from astb.panel.runs import CannotDo, refuse_settings
from astb.panel.specimens import Specimens
from astb.rehearsal.again import AFTER_THAT
from bench_protocol.input_limits import RESULT_BYTES, read_bounded
from bench_records.layout import RecordError
from bench_records.result import read_result

if TYPE_CHECKING:
    from astb.panel.answers import Parts

#: The file of a rehearsal, next to its record.
PAGE: Final = "rehearsal.html"
_NAME: Final = "-rehearsal"
_TAIL: Final = 4000  # characters
#: Changes of a run from an instant on: options of `astb rehearse`.
CHANGES: Final = ("fault", "effect", "change")
#: A rig in real time has priority for the processor.
_NICE: Final = ("nice", "-n", "15")


def routes(parts: Parts) -> Sequence[Route]:
    """Return the routes of rehearsals: start, state, and page."""
    rehearsals = Rehearsals(parts)
    return [
        Route("/api/rehearsal", answered(lambda request: rehearsals.state())),
        command(parts, "/api/rehearsal/start", lambda request, body: rehearsals.start(body)),
        command(parts, "/api/rehearsal/from", lambda request, body: rehearsals.go_on(body)),
        Route("/kept/rehearsal", answered(lambda request: rehearsals.page(request.query_params["of"]))),
    ]


class Rehearsals:
    """One rehearsal at a time, and the result of the last one."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._process: subprocess.Popen[str] | None = None
        self._plan = ""
        self._said = ""
        self._lock = threading.Lock()

    def start(self, body: Mapping[str, Any]) -> None:
        """Start to rehearse a plan.

        Raises CannotDo during a run or a rehearsal, or for settings that the plan refuses.
        """
        plan, settings = text_of(body, "plan"), settings_of(body)
        refuse_settings(plan, settings)
        specimen = Specimens(self._parts.out).place(text_of(body, "specimen"))
        chosen = [plan, *(part for name, text in settings.items() for part in ("--set", f"{name}={text}"))]
        self._launch(plan, [*chosen, f"--specimen={specimen}"] if specimen else chosen)

    def go_on(self, body: Mapping[str, Any]) -> None:
        """Start to repeat a recorded run, and to continue it with changes from a given time on. `state` reports refused
        changes.

        Raises CannotDo during a run or a rehearsal, or if the run does not exist; NotAllowed for an invalid request.
        """
        try:
            directory = Kept(self._parts.out).known(text_of(body, "run"))
            plan = read_result(directory).plan
        except RecordError as error:
            raise CannotDo(str(error)) from None
        at = body.get("at")
        if not isinstance(at, int | float) or isinstance(at, bool):
            raise NotAllowed(f"at = {at!r} is not a number; send the time in s", 400)
        changes = [f"--{kind}={text}" for kind in CHANGES if (text := text_of(body, kind).strip())]
        self._launch(plan, [f"--from={directory}@{at:.3f}s", *changes])

    def _launch(self, plan: str, arguments: Sequence[str]) -> None:
        with self._lock:
            if self._parts.runs.going:
                raise CannotDo(
                    "a run is in progress, and its rig needs this processor; rehearse before or after the run"
                )
            if self._process is not None and self._process.poll() is None:
                raise CannotDo(f"{self._plan} is being rehearsed; wait until the rehearsal has ended")
            command = [
                *(_NICE if which("nice") else ()),
                sys.executable,
                "-m",
                "astb",
                "rehearse",
                *arguments,
            ]
            command += ["--rig", str(self._parts.watch.path), "--out", str(self._parts.out)]
            self._plan, self._said = plan, ""
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
            threading.Thread(target=self._listen, args=(self._process,), daemon=True).start()

    def _listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                self._said = (self._said + line)[-_TAIL:]
        process.wait()

    def state(self) -> dict[str, Any]:
        """Return the state: the plan, whether it is in progress, its result, and the folder of its page."""
        process = self._process
        if process is None:
            return {"plan": "", "going": False}
        if process.poll() is None:
            return {"plan": self._plan, "going": True}
        lines = self._said.strip().splitlines()
        verdict = next(
            (one for one in lines if one.startswith(f"{self._plan}: ")), lines[-1] if lines else ""
        )
        page = next((one.partition("page: ")[2].strip() for one in lines if "page: " in one), "")
        return {
            "plan": self._plan,
            "going": False,
            "words": verdict.removeprefix(f"{self._plan}: "),
            "page": Path(page).parent.name if page else "",
            "otherwise": [
                one.strip() for one in self._said.partition(AFTER_THAT)[2].splitlines()[1:] if one.strip()
            ],
            "code": process.returncode,
        }

    def page(self, of: str) -> str:
        """Return the page of a rehearsal. Raises RecordError if the folder ``of`` has none."""
        path = self._parts.out / of / PAGE
        if Path(of).name != of or _NAME not in of or not path.is_file():
            raise RecordError(f"{self._parts.out} holds no rehearsal {of}; reload the page")
        return read_bounded(path, RESULT_BYTES).decode("utf-8")
