"""Where Linux is not: virtual time and whatever reads records do the same there, byte for byte."""

import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event
from urllib.error import URLError
from urllib.request import urlopen

import msgspec
import pytest

ROOT = Path(__file__).parents[2]
SHIM = str(ROOT / "tests" / "not_linux.py")
SYSTEMS = ("win32", "darwin")
#: The shortest plan of all that are made for a diagnosis.
SINES = "small_fast_sines"
LEAKS = ("--effects", "leak.left,leak.right")
Cli = Callable[..., str]


def _cli(*start: str) -> Cli:
    """Return what runs `astb` with arguments and returns what it prints; it must end with 0 and say nothing wrong."""

    def run(*arguments: str | Path) -> str:
        done = subprocess.run(
            [sys.executable, "-W", "error::EncodingWarning", *start, *map(str, arguments)],
            cwd=ROOT, capture_output=True, text=True, check=False, timeout=280,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        return done.stdout

    return run


def _files(folder: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in sorted(folder.iterdir()) if one.is_file()}


def _answered(address: str) -> bytes:
    """Return the answer of a server that reports its address a moment before it listens."""
    for _ in range(100):
        with suppress(URLError), urlopen(address) as answer:
            return answer.read()
        Event().wait(0.1)
    raise AssertionError(f"nobody answers at {address}")


@pytest.fixture(scope="session")
def linux(once) -> Path:
    """A run of aw0 and one of small fast sines on this Linux, and their finding."""

    def made(out: Path) -> Path:
        here = _cli("-m", "astb")
        here("run", "aw0", SINES, "--virtual", "--seed", "3", "--out", out)
        here("diagnose", out / SINES, *LEAKS, "--out", out / "finding")
        return out

    return once("linux", made)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_run_its_report_and_its_diagnosis_are_the_same(system: str, linux: Path, tmp_path: Path) -> None:
    here, there = _cli("-m", "astb"), _cli(SHIM, system)
    there("run", "aw0", "--virtual", "--seed", "3", "--out", tmp_path)
    assert _files(tmp_path / "aw0") == _files(linux / "aw0")

    (tmp_path / "aw0" / "report.html").unlink()
    there("report", tmp_path / "aw0")
    assert _files(tmp_path / "aw0") == _files(linux / "aw0")

    for what in (("runs", "--out", linux), ("compare", linux / "aw0", tmp_path / "aw0")):
        told, told_there = here(*what), there(*what)
        assert told == told_there and told.strip()

    there("diagnose", linux / SINES, *LEAKS, "--out", tmp_path / "finding")
    findings = [
        msgspec.json.decode((out / "finding" / "finding.json").read_bytes()) for out in (linux, tmp_path)
    ]
    assert findings[0] == findings[1] and findings[0]["verdict"]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("system", SYSTEMS)
def test_the_panel_shows_kept_records(system: str, linux: Path) -> None:
    command = [sys.executable, SHIM, system, "panel", "--port", "0", "--out", str(linux)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as panel:
        try:
            text = ""
            while not (found := re.search(r"to watch: +(http://\S+)", text)):
                line = panel.stdout.readline()
                assert line, text
                text += line
            assert "a rig in real time needs Linux" in text
            assert b"aw0" in _answered(f"{found[1]}api/kept")
        finally:
            panel.terminate()
