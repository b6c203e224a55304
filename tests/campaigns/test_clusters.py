"""Campaigns on a scheduler and workers in processes of their own, and campaigns that are killed: slow, all of it."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from astb.campaigns.kept import read_rows
from astb.campaigns.run import run_cases
from tests.campaigns import questions

ROOT = Path(__file__).parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}

CAMPAIGN = """
import sys
from astb.campaigns.run import run_cases
from tests.campaigns import questions

if __name__ == "__main__":
    directory, rows, count, seconds = sys.argv[1:]
    cases = {f"c{n:03}": (directory, f"c{n:03}", float(seconds)) for n in range(int(count))}
    run_cases(questions.seen, cases, rows, workers=2, watch=lambda one: print(one.done, flush=True))
"""


@contextmanager
def process(*command: str, wanted: str) -> Iterator[tuple[subprocess.Popen, str]]:
    """Run a command, in a separate process group, during the block; yield it, and its line with ``wanted``."""
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        env=ENVIRONMENT,
        process_group=0,
    ) as child:
        watchdog = threading.Timer(100, child.kill)
        watchdog.start()
        try:
            yield child, next(line for line in child.stdout if wanted in line)
        finally:
            watchdog.cancel()
            child.kill()


@contextmanager
def cluster_of_others(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Yield the address of a scheduler and its two workers, which are not restarted."""
    dask = str(Path(sys.executable).with_name("dask"))
    with ExitStack() as stack:
        _, said = stack.enter_context(
            process(
                dask,
                "scheduler",
                "--host",
                "127.0.0.1",
                "--port",
                "0",
                "--no-dashboard",
                wanted="Scheduler at:",
            )
        )
        address = re.search(r"tcp://\S+", said)[0]
        workers = [
            stack.enter_context(
                process(
                    *(dask, "worker", address, "--host", "127.0.0.1", "--no-nanny", "--no-dashboard"),
                    *("--nthreads", "1", "--local-directory", str(tmp_path / f"worker-{n}")),
                    wanted="Registered to:",
                )
            )[0]
            for n in range(2)
        ]
        yield address, workers


@pytest.mark.slow
def test_a_worker_of_somebody_elses_cluster_is_killed_and_every_row_is_there_once(tmp_path):
    cases = {f"c{n:03}": (str(tmp_path), f"c{n:03}", 0.1) for n in range(40)}
    with cluster_of_others(tmp_path) as (address, workers):

        def kill_one(standing):
            if standing.done == 10:
                workers[0].send_signal(signal.SIGKILL)

        rows = run_cases(questions.seen, cases, tmp_path / "rows", scheduler=address, watch=kill_one)
        assert workers[0].wait(5) == -signal.SIGKILL
    assert [row["name"] for row in rows] == list(cases)
    assert all(row["error"] == "" for row in rows)
    assert Counter(row["key"] for row in read_rows(tmp_path / "rows")) == Counter(list(cases))
    begun = Counter((tmp_path / name).read_text().count("begun") for name in cases)
    assert begun[1] >= len(cases) - 1, "only what the dead worker was at is done again"
    assert len({row["worker"] for row in rows}) == 2


@pytest.mark.slow
def test_a_campaign_that_is_killed_goes_on_where_it_stopped(tmp_path):
    script = tmp_path / "campaign.py"
    script.write_text(CAMPAIGN)
    command = [sys.executable, str(script), str(tmp_path), str(tmp_path / "rows"), "30", "0.1"]
    with process(*command, wanted="9") as (child, _):
        child.send_signal(signal.SIGKILL)
        child.wait(5)
    kept = {row["key"] for row in read_rows(tmp_path / "rows")}
    assert 9 <= len(kept) < 30
    time.sleep(1.0)  # workers of a dead campaign end by themselves, and begin nothing more
    at_work = {path.name for path in tmp_path.glob("c[0-9]*")} - kept
    assert len(at_work) <= 2
    again = subprocess.run(
        command, cwd=ROOT, env=ENVIRONMENT, timeout=100, capture_output=True, text=True, check=True
    )
    assert again.stdout.splitlines()[-1] == str(30 - len(kept))
    assert sorted(row["key"] for row in read_rows(tmp_path / "rows")) == [f"c{n:03}" for n in range(30)]
    begun = {name: (tmp_path / name).read_text().count("begun") for name in (f"c{n:03}" for n in range(30))}
    assert all(times == 1 for name, times in begun.items() if name not in at_work), begun


@pytest.mark.slow
def test_a_campaign_that_is_interrupted_ends_soon_and_keeps_what_is_done(tmp_path):
    script = tmp_path / "campaign.py"
    script.write_text(CAMPAIGN)
    command = [sys.executable, str(script), str(tmp_path), str(tmp_path / "rows"), "1000", "0.1"]
    with process(*command, wanted="5") as (child, _):
        os.killpg(child.pid, signal.SIGINT)  # as a terminal does
        said = child.stdout.read()
        assert child.wait(15) != 0
    assert said.count("Traceback") == 1, "the campaign's own; its workers are deaf to it"
    kept = read_rows(tmp_path / "rows")
    assert 5 <= len(kept) < 1000
    assert len(list((tmp_path / "rows").glob("part-*"))) == 1, "the parts are joined on the way out"
