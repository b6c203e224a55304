"""An assistant reads runs, results and tables, and rehearses plans. It reaches no rig, and no other file."""

import asyncio
import json
import socket
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from astb.api import run_plan
from bench_records.record import read
from test_plans.plan import plan

mcp = pytest.importorskip("mcp")
from astb.mcp_server import ROWS, mcp_server  # noqa: E402


@plan
def still(run) -> None:
    """Wait for two seconds."""
    with run.phase("wait"):
        run.bench.wait(2.0)
    run.check("height", run.bench.average("left.height", over=0.1), "mm", low=-1.0, high=1.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    run_plan(still, out=folder)
    found = folder / "diagnosed"
    found.mkdir()
    (found / "finding.json").write_text('{"verdict": "no effect"}')
    (folder.parent / "finding.json").write_text('{"secret": 1}')
    return folder


def in_a_thread(work):
    """Return what a coroutine returns; a browser of other tests has an event loop in this thread."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()


def asked(folder, tool, **arguments):
    """Return the answer of a tool to a client of the official library."""

    async def ask():
        async with mcp.Client(mcp_server(folder)) as client:
            return await client.call_tool(tool, arguments)

    answer = in_a_thread(ask())
    if answer.is_error:
        return answer.content[0].text
    found = answer.structured_content
    return found["result"] if set(found) == {"result"} else found


def test_runs_results_tables_and_findings_are_read(folder):
    (run,) = asked(folder, "list_runs", plan="still")
    directory = run["directory"]
    assert asked(folder, "list_runs", plan="aw0") == []
    result = asked(folder, "read_result", run=directory)
    assert result == json.loads((folder / directory / "result.json").read_text())
    assert asked(folder, "list_signals", run=directory)["left.height"] == "mm"
    table = asked(folder, "read_table", run=directory, signals=["left.height"], rate=10.0, start=0.5, end=1.5)
    times, values = read(folder / directory).series("left.height")
    assert len(table["time_s"]) == 11
    expected = 1e3 * np.interp(table["time_s"], times, values)
    assert table["left.height"] == pytest.approx(expected.tolist(), abs=1e-9)
    assert asked(folder, "list_findings") == ["diagnosed"]
    assert asked(folder, "read_finding", finding="diagnosed") == {"verdict": "no effect"}


@pytest.mark.parametrize(
    ("tool", "arguments", "part"),
    [
        ("read_result", {"run": "../runs"}, "'../runs'"),
        ("read_result", {"run": "/etc"}, "'/etc'"),
        ("read_finding", {"finding": ".."}, "'..'"),
        ("read_table", {"run": "RUN", "signals": ["left.hight"], "rate": 1.0}, "'left.hight'"),
        ("read_table", {"run": "RUN", "signals": ["left.height"], "rate": 1e4}, str(ROWS)),
        ("rehearse_plan", {"plan": "aw9"}, "'aw9'"),
        ("rehearse_plan", {"plan": "aw0", "rig": "nowhere"}, "nowhere"),
        ("rehearse_plan", {"plan": "leveling", "parameters": {"step": "90 mm"}}, "90 mm"),
    ],
)
def test_an_error_names_the_wrong_value(folder, tool, arguments, part):
    (run,) = asked(folder, "list_runs")
    given = {name: run["directory"] if value == "RUN" else value for name, value in arguments.items()}
    answer = asked(folder, tool, **given)
    assert isinstance(answer, str), answer
    assert part in answer


def content(folder):
    return {
        path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and "index" not in path.name
    }


def test_no_tool_opens_a_socket_or_changes_a_run(folder, tmp_path, monkeypatch):
    """A rehearsal of a real rig is a simulation: connecting to that rig would need a socket."""
    rig = tmp_path / "hall.toml"
    rig.write_text('name = "hall"\n[modbus]\nhost = "127.0.0.1"\nport = 1\n')
    before = content(folder)

    def refuse(*_, **__):
        raise AssertionError("a socket to a rig")

    async def all_tools():
        async with mcp.Client(mcp_server(folder)) as client:
            tools = (await client.list_tools()).tools
            monkeypatch.setattr(socket.socket, "connect", refuse)
            monkeypatch.setattr(socket.socket, "bind", refuse)
            found = await client.call_tool("rehearse_plan", {"plan": "leak_down", "rig": str(rig)})
            return tools, found

    tools, found = in_a_thread(all_tools())
    assert all(tool.annotations.read_only_hint for tool in tools)
    assert not found.is_error, found.content
    assert found.structured_content["limits"]
    assert content(folder) == before


def test_the_command_serves_on_standard_input_and_output(folder):
    """A client in another process starts the command, as assistants do."""
    from mcp import StdioServerParameters

    command = StdioServerParameters(
        command=sys.executable, args=["-m", "astb", "runs", "--out", str(folder), "--mcp"]
    )

    async def ask():
        async with mcp.Client(command) as client:
            return await client.call_tool("list_runs", {})

    (run,) = in_a_thread(ask()).structured_content["result"]
    assert run["plan"] == "still"
