"""Starts runs, each `astb run` in its own process, and forwards requests of the panel to the present run."""

import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any, Final

from astb.live.door import NoRun, knock
from astb.operators import PANEL
from astb.panel.kept_rig import KeptRig
from astb.panel.watch import Watch
from bench_protocol.clock import wall_time_ns
from bench_protocol.units import s
from bench_protocol.words import SIDES
from bench_records.layout import RESULT, RecordError
from bench_records.result import CheckVerdict, read_result
from drivers.errors import BenchError
from test_plans.air_left import LIFTS
from test_plans.analysis import CHAMBERS
from test_plans.discovery import plans, unknown
from test_plans.parameters import ParameterRefused

#: A run that does not answer within this time is killed by an emergency stop: the rig then holds.
STOP_WITHIN: Final = 1 * s
_LOG_TAIL: Final = 2000  # bytes
MS: Final = 1_000_000  # ns
#: Pressure signals of each side: the bellows first, because without it the amount of air is unknown.
_AIR: Final = {side: [f"{side}.{chamber}_pressure" for chamber in CHAMBERS] for side in SIDES}
#: Name of the user who stopped a run, if the page does not know it.
SOMEBODY: Final = "a user of the panel"
_FAILED: Final = (CheckVerdict.FAIL, CheckVerdict.ERROR)


@dataclass(slots=True)
class Stopped:
    """An emergency stop: user, action, time (ns since 1970), and the time when the springs were empty."""

    by: str
    how: str
    at: int
    emptied: int | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the stop for the page, with times in ms."""
        return {
            "by": self.by,
            "how": self.how,
            "at": self.at // MS,
            "empty": None if self.emptied is None else self.emptied // MS,
        }


class CannotDo(Exception):
    """An action that is impossible now; the text states why, and what to do."""


class Runs:
    """The runs on one rig: those started here, and those that the panel found."""

    def __init__(self, watch: Watch, out: Path, kept: KeptRig | None = None) -> None:
        self._watch, self.out, self._kept = watch, out, kept
        self._process: subprocess.Popen[bytes] | None = None
        self._log: Path | None = None
        self._record = ""  # of the last run that was seen
        self._concluded: tuple[str, dict[str, Any]] | None = None  # result of this run
        self.stopped: Stopped | None = None  #: of the last emergency stop, until another run starts
        self._stops = 0
        self._starts = threading.Lock()

    # -- start and end ---------------------------------------------------------------------------------------------

    def start(
        self,
        plan: str,
        settings: Mapping[str, str],
        *,
        specimen: str = "",
        operator: str = "",
        ambient: str = "",
        twin: bool = False,
    ) -> None:
        """Start a run of a plan, with parameters as text. With ``twin``, the rig is compared with its model during the
        run.

        Raises CannotDo, with the message of `astb run` if this refuses.
        """
        stops = self._stops
        if self._watch.lacks_stop:
            raise CannotDo(f"no run can start on a rig that cannot be stopped: {self._watch.lacks_stop}")
        refuse_settings(plan, settings)
        with self._starts:  # a double click starts one run
            if self.going:
                raise CannotDo("a run is in progress already; stop it, or wait for its end")
            if link := self._watch.present().link:
                raise CannotDo(f"no data from the rig: {link}")
            content = {"specimen": specimen, "operator": operator, "ambient": ambient}
            self._launch(plan, settings, content, ["--watch"] if twin else [])
            if self._stops != stops:  # a stop that came meanwhile may not have reached the new process
                assert self._process is not None
                self._process.kill()
                raise CannotDo("STOP was pressed while the run was starting; the run was ended at once")

    def _launch(
        self, plan: str, settings: Mapping[str, str], options: Mapping[str, str], more: Sequence[str]
    ) -> None:
        command = [sys.executable, "-m", "astb", "run", plan, "--rig", str(self._watch.path)]
        command += ["--out", str(self.out), "--answers", PANEL]
        command += [part for name, text in settings.items() for part in ("--set", f"{name}={text}")]
        command += [f"--{name}={text}" for name, text in options.items() if text]
        command += more
        if self._log is not None:  # the log of the previous run is no longer requested
            self._log.unlink(missing_ok=True)
        lifeline = None if self._kept is None else self._kept.lifeline
        with tempfile.NamedTemporaryFile(prefix="astb-run-", suffix=".log", delete=False) as log:
            self._log, self._record, self.stopped = Path(log.name), "", None
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C and the end of the panel's terminal do not reach the run
                pass_fds=() if lifeline is None else (lifeline,),
            )

    @property
    def going(self) -> bool:
        """Whether a run is in progress, started here or elsewhere on this machine with the same rig file."""
        return self._watch.status.pid is not None or self._starting

    @property
    def _starting(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def order(self, do: str, **more: str) -> None:
        """Send an order to the run: hold, resume, stop, answer.

        Raises CannotDo without a run, or if the run refuses.
        """
        try:
            answer = knock(self._watch.path, {"do": do, **more})
        except NoRun:
            if do == "stop" and self._starting:  # it has no door yet, and nothing moves
                assert self._process is not None
                self._process.terminate()
                return
            raise CannotDo("no run is in progress; start one first") from None
        if "error" in answer:
            raise CannotDo(answer["error"])

    def emergency_stop(self, by: str = "") -> str:
        """Bring the bench to its safe position over the buses, and end the run; return a description of the action.

        ``by`` is the name of the user, if the page knows it.

        The run sends the order to the rig, as its commander. A run that does not answer is killed; the rig then holds
        and vents, because its commander is lost. Without a run the panel sends the order. Raises CannotDo if the
        rig did not receive it.
        """
        if self._watch.lacks_stop and not self.going:
            raise CannotDo(self._watch.lacks_stop)
        self._stops += 1
        at, pid, by = wall_time_ns(), self._watch.status.pid, by.strip() or SOMEBODY
        try:
            answer = knock(self._watch.path, {"do": "safe", "by": by}, STOP_WITHIN)
        except NoRun:
            answer = {"error": "the run does not answer"}
        if "error" not in answer:
            how = (
                "the run was commanded to bring the bench to its safe position, and to end"
                if answer.get("bench")
                else "no plan of the run commanded the bench; the run was commanded to end"
            )
        elif pid is not None or self._starting:
            self._kill(pid)
            how = (
                f"{answer['error']}: the process of the run was killed, and the rig holds without a commander"
            )
        else:
            how = self._directly()
        self.stopped = Stopped(by, how, at)
        return how

    def _look_at_the_air(self) -> None:
        """Record the time when the springs are empty after a stop."""
        if self.stopped is None or self.stopped.emptied is not None or self._watch.present().link:
            return
        if all(self._empty(names) for names in _AIR.values()):
            self.stopped.emptied = wall_time_ns()

    def _empty(self, names: list[str]) -> bool:
        first, *others = self._watch.glimpses(names).values()
        return first < LIFTS and all(isnan(one) or one < LIFTS for one in others)

    def _kill(self, pid: int | None) -> None:
        for one in {pid, self._process.pid if self._process and self._starting else None} - {None}:
            assert one is not None
            try:
                os.kill(one, signal.SIGKILL)
            except ProcessLookupError:
                self._directly()

    def _directly(self) -> str:
        try:
            self._watch.go_safe()
        except BenchError as error:
            rig = self._watch.present()
            if not rig.link and rig.at_rest:
                return f"the rig is in its safe position already: its state is {rig.state}"
            raise CannotDo(f"the rig did not take its safe position: {error}") from None
        return "the rig was commanded to its safe position"

    def reset(self) -> None:
        """Clear a latched fault. Raises CannotDo if a run commands the rig, or if the rig refuses."""
        self._by_hand(lambda: self._watch.act("action.reset"))

    def vent(self) -> None:
        """Vent both springs. Raises CannotDo if a run commands the rig, or if the rig refuses."""
        self._by_hand(lambda: self._watch.write({"air.left_mode": "vent", "air.right_mode": "vent"}))

    def _by_hand(self, do: Callable[[], None]) -> None:
        if self.going:
            raise CannotDo("a run commands the rig; stop the run first")
        try:
            do()
        except BenchError as error:
            raise CannotDo(str(error)) from None

    def moved(self, old: Path, new: Path) -> None:
        """Update the folder of a run after it was renamed; the last run remains visible."""
        if self._record and Path(self._record) == old.resolve():
            self._record = str(new.resolve())

    # -- state for the page ----------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Return the state of runs for the page: whether one starts or ends, the last emergency stop, and the result of
        the last run.
        """
        snapshot = self._watch.status.run
        if snapshot is not None:
            self._record = snapshot["record"]
        self._look_at_the_air()
        lonely = self._starting and snapshot is None
        content: dict[str, Any] = {
            "starting": lonely and not self._record,
            "ending": (lonely and bool(self._record)) or bool(snapshot and snapshot["ended"]),
            "stopped": None if self.stopped is None else self.stopped.as_json(),
        }
        if self._watch.status.pid is None and not self._starting:
            content["last"] = self._last()
        return content

    def _last(self) -> dict[str, Any] | None:
        if self._record and (Path(self._record) / RESULT).exists():
            if self._concluded is None or self._concluded[0] != self._record:  # read once, and shown often
                self._concluded = self._record, _conclusion(Path(self._record), self.out)
            return self._concluded[1]
        if self._process is not None and self._log is not None and self._log.exists():
            tail = self._log.read_bytes()[-_LOG_TAIL:].decode(errors="replace").strip().splitlines()
            if tail:
                return {"plan": "", "verdict": "blocked", "reason": tail[-1], "record": ""}
        return None


def refuse_settings(plan: str, settings: Mapping[str, str]) -> None:
    """Raise CannotDo, with the message of the command line, for an unknown plan or invalid settings."""
    if (known := plans().get(plan)) is None:
        raise CannotDo(unknown(plan))
    try:
        known.given(settings)
    except ParameterRefused as error:
        raise CannotDo(str(error)) from None


def _conclusion(record: Path, out: Path) -> dict[str, Any]:
    """Return the result of a finished run for the page. The page can open its report if the record is in ``out``."""
    try:
        result = read_result(record)
    except RecordError as error:
        return {"plan": "", "verdict": "", "reason": str(error), "record": ""}
    return {
        "plan": result.plan,
        "verdict": result.verdict.value,
        "reason": result.reason,
        "failed": [{"text": str(one), "about": one.about} for one in result.checks if one.verdict in _FAILED],
        "record": record.name if record.parent == out.resolve() else "",
    }
