"""Recorded runs for assistants and scripts: a read-only server of the Model Context Protocol (the extra ``mcp``).

No tool commands a rig. `rehearse_plan` runs in virtual time on the simulated rig that takes the place of the named one.
"""

from collections.abc import Callable
from functools import wraps
from math import isnan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import msgspec
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import ToolAnnotations

from astb.diagnose import FINDING
from astb.rehearsal.rehearsing import rehearse
from astb.rig_file import ORDINARY, find_rig
from bench_records.index import RunIndex
from bench_records.layout import RecordError
from bench_records.record import read
from bench_records.run_folder import open_run
from drivers.errors import BenchError
from test_plans.discovery import plans, unknown

#: Rows of one table: an assistant reads text, and asks again for another part.
ROWS: Final = 2000


class RunReader:
    """The tools of the server, for the runs in ``folder``. Raises RecordError if it is not a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._index = folder, RunIndex(folder)

    def list_runs(self, plan: str | None = None, verdict: str | None = None) -> list[dict[str, Any]]:
        """List the recorded runs, oldest first: directory, plan, parameters, rig, specimen, verdict and reason."""
        return list(_plain(self._index.runs(plan=plan, verdict=verdict)))

    def read_result(self, run: str) -> dict[str, Any]:
        """Return the result of a run: checks with values (SI), uncertainty, limits and verdicts. run: a directory."""
        return dict(_plain(open_run(self._run_folder(run)).result))

    def list_signals(self, run: str) -> dict[str, str]:
        """Return the recorded signals of a run with the units of read_table."""
        return {name: signal.unit for name, signal in read(self._run_folder(run)).signals.items()}

    def read_table(
        self, run: str, signals: list[str], rate: float, start: float = 0.0, end: float | None = None
    ) -> dict[str, list[float | None]]:
        """Return signals at one rate (Hz), with time_s since the start of the record; null without a sample."""
        record = read(self._run_folder(run))
        table = record.frame(signals, rate).loc[start:end]
        if len(table) > ROWS:
            raise RecordError(
                f"the table has {len(table)} rows, but at most {ROWS} are returned; "
                "give a lower rate, or start and end in s"
            )
        scaled = table / [record.signals[name].scale for name in signals]
        return {str(name): _nullable(values) for name, values in scaled.reset_index().items()}

    def list_findings(self) -> list[str]:
        """List the folders with a finding of `astb diagnose`."""
        return sorted(str(path.parent.relative_to(self._folder)) for path in self._folder.rglob(FINDING))

    def read_finding(self, finding: str) -> dict[str, Any]:
        """Return a finding: verdict, causes with intervals, alternatives, goodness of fit. finding: a folder."""
        if finding not in self.list_findings():
            raise RecordError(
                f"{finding!r} in {self._folder} has no {FINDING}; list_findings returns the folders with findings"
            )
        return dict(msgspec.json.decode((self._folder / finding / FINDING).read_bytes()))

    def rehearse_plan(
        self, plan: str, parameters: dict[str, str] | None = None, rig: str = ORDINARY
    ) -> dict[str, Any]:
        """Simulate a plan in virtual time, and return its margins to the limits of the rig. The rig does not move."""
        if plan not in plans():  # by name only: a path would run any Python file
            raise RecordError(unknown(plan))
        file, path = find_rig(rig)
        with TemporaryDirectory() as out:
            found, _ = rehearse(plans()[plan].given(parameters or {}), file, path, Path(out))
            return dict(_plain(found))

    def _run_folder(self, run: str) -> Path:
        """Return the folder of a run. Raises RecordError for any other name, so that nothing else can be read."""
        if not self._index.runs(directory=run):
            raise RecordError(f"no run {run!r} in {self._folder}; list_runs returns the directories")
        return self._folder / run


def mcp_server(folder: Path) -> MCPServer:
    """Return the server of the runs in ``folder``. Raises RecordError if it is not a folder."""
    reader = RunReader(folder)
    server = MCPServer("astb", instructions="Recorded runs of a test bench for air springs.")
    reads = ToolAnnotations(read_only_hint=True, open_world_hint=False)
    for tool in (
        reader.list_runs,
        reader.read_result,
        reader.list_signals,
        reader.read_table,
        reader.list_findings,
        reader.read_finding,
        reader.rehearse_plan,
    ):
        server.tool(annotations=reads)(_with_messages(tool))
    return server


def _with_messages(tool: Callable[..., Any]) -> Callable[..., Any]:
    """Return ``tool`` with its known errors raised as ToolError.

    The library does not send the messages of other errors to the client.
    """

    @wraps(tool)
    def answering(**arguments: Any) -> Any:
        try:
            return tool(**arguments)
        except (RecordError, BenchError, ValueError) as error:
            raise ToolError(str(error)) from None

    return answering


def _plain(found: Any) -> Any:
    """Return ``found`` as JSON values: NaN becomes null."""
    return msgspec.json.decode(msgspec.json.encode(found))


def _nullable(values: Any) -> list[float | None]:
    return [None if isnan(value) else float(value) for value in values]
