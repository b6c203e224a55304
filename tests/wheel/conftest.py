"""An sdist and a wheel of the present tree, and an environment with only their contents."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Compiles a part of what is installed.
COMPILE = "import runpy; runpy.run_path({tool!r})[{part!r}]()"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker("wheel")
            item.add_marker("slow")
            item.add_marker(pytest.mark.timeout(1200))


def carried_out(
    *command: str | Path, cwd: Path, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess:
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=900, check=False)


def sure(done: subprocess.CompletedProcess) -> str:
    """Return what a command printed that ended well."""
    assert done.returncode == 0, f"{done.args}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}"
    return done.stdout


def at_once(*commands: tuple[list[str], Path, dict[str, str] | None]) -> None:
    """Carry out commands side by side, each in its directory and environment; all must end well."""
    with ThreadPoolExecutor() as threads:
        for done in threads.map(lambda one: carried_out(*one[0], cwd=one[1], env=one[2]), commands):
            sure(done)


class Built(NamedTuple):
    """The built files, and their sources."""

    source: Path
    tracked: list[str]
    sdist: Path
    of_sources: Path  #: the wheel that the tree gives
    of_sdist: Path  #: and that of the sdist


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Build in a clone with the files of the working tree, where nothing lies that git does not know."""
    if not (ROOT / ".git").exists():
        pytest.skip("only a checkout knows its files")
    place = tmp_path_factory.mktemp("built")
    source = place / "source"
    sure(carried_out("git", "clone", "--quiet", "--shared", str(ROOT), str(source), cwd=place))
    tracked = sure(carried_out("git", "ls-files", "-z", cwd=ROOT)).strip("\0").split("\0")
    for name in sure(carried_out("git", "ls-files", "-z", cwd=source)).strip("\0").split("\0"):
        (source / name).unlink()
    for name in (tracked := [name for name in tracked if (ROOT / name).exists()]):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    # Side by side, each where the other one leaves nothing: the second one makes an sdist, and a wheel of that.
    second = shutil.copytree(source, place / "second")
    command = [sys.executable, "-m", "build"]
    at_once(
        ([*command, "--wheel", "--outdir", str(place / "tree")], source, None),
        ([*command, "--outdir", str(place / "sdist")], second, None),
    )
    (of_sources,) = (place / "tree").glob("*.whl")
    (of_sdist,) = (place / "sdist").glob("*.whl")
    (sdist,) = (place / "sdist").glob("*.tar.gz")
    return Built(source, tracked, sdist, of_sources, of_sdist)


class CleanMachine:
    """A computer without a checkout: an environment, an empty home and an empty working directory."""

    def __init__(self, place: Path) -> None:
        self.bin = place / "environment" / "bin"
        self.here = place / "here"
        self.here.mkdir()
        (place / "home").mkdir()
        kept = ("PATH", "LANG", "ASTB_CHROMIUM")
        self.env = {name: os.environ[name] for name in kept if name in os.environ} | {
            "HOME": str(place / "home"),
            "OPENBLAS_NUM_THREADS": "1",
        }

    def try_astb(self, *arguments: str | Path) -> subprocess.CompletedProcess:
        return carried_out(self.bin / "astb", *arguments, cwd=self.here, env=self.env)

    def astb(self, *arguments: str | Path) -> str:
        return sure(self.try_astb(*arguments))

    def python(self, program: str) -> str:
        """Run a program, which may not import from where it stands: `-P`."""
        return sure(carried_out(self.bin / "python", "-P", "-c", program, cwd=self.here, env=self.env))

    def install(self, *what: str) -> None:
        command = (
            self.bin / "python",
            "-m",
            "pip",
            "install",
            "--quiet",
            "--no-compile",
            "--no-input",
            *what,
        )
        # pip's own cache is that of the user who runs the tests.
        sure(carried_out(*command, cwd=self.here))


@pytest.fixture(scope="session")
def clean_machine(built: Built, tmp_path_factory: pytest.TempPathFactory) -> CleanMachine:
    """Where the wheel is installed, without extras."""
    place = tmp_path_factory.mktemp("elsewhere")
    sure(carried_out(sys.executable, "-m", "venv", place / "environment", cwd=place))
    there = CleanMachine(place)
    there.install(str(built.of_sources))
    # Side by side; the first commands would compile the same, one after the other.
    tool = str(ROOT / "tools" / "compile_model.py")
    at_once(
        *(
            (
                [str(there.bin / "python"), "-P", "-c", COMPILE.format(tool=tool, part=part)],
                there.here,
                there.env,
            )
            for part in ("compile_rig", "compile_diagnosis")
        )
    )
    return there
