"""Commands of other packages: found by their entry points, imported only when asked for, and harmless when broken."""

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from astb.exit_codes import MISUSE, PASS

ROOT = Path(__file__).parents[2]
HOW_TO = ROOT / "docs" / "how-to" / "write-plans.md"
GOOD = "import click\n\n@click.command()\ndef command():\n    'Greets.'\n    click.echo('hello')\n"

Install = Callable[..., None]
Astb = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A directory of installed packages, in addition to those of the environment."""
    directory = tmp_path / "site-packages"
    directory.mkdir()
    return directory


@pytest.fixture
def install(site: Path) -> Install:
    """Put a package with one module and entry points into the site, as an installer does."""

    def installed(package: str, source: str, **commands: str) -> None:
        (site / f"{package}.py").write_text(source)
        metadata = site / f"{package}-1.2.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
        points = "".join(f"{name} = {target}\n" for name, target in commands.items())
        (metadata / "entry_points.txt").write_text(f"[astb.commands]\n{points}")

    return installed


@pytest.fixture
def astb(site: Path, tmp_path: Path) -> Astb:
    """Run ``astb`` where the packages of the site are installed too."""

    def run(*arguments: str, options: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *options, "-m", "astb", *arguments],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": f"{site}{os.pathsep}{ROOT}", "COLUMNS": "200"},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def test_the_papers_study_is_found_as_anybodys_is(astb: Astb) -> None:
    """If this fails, the environment is older than pyproject.toml: `make` brings it up to date."""
    done = astb("paper", "--help")
    assert (done.returncode, done.stderr) == (PASS, "")
    assert "paper's figures" in done.stdout


def test_no_module_of_astb_names_the_studies() -> None:
    for path in (ROOT / "astb").rglob("*.py"):
        assert "astb_studies.paper" not in path.read_text(), path


def test_a_command_of_another_package_is_listed_and_run(install: Install, astb: Astb) -> None:
    install("greetings", GOOD, greet="greetings:command")
    listed = astb("--help")
    assert re.search(r"^  greet +greetings 1\.2$", listed.stdout, re.MULTILINE)
    done = astb("greet")
    assert (done.returncode, done.stdout, done.stderr) == (PASS, "hello\n", "")


def test_only_the_command_that_is_run_is_imported(install: Install, astb: Astb) -> None:
    """Neither other packages nor the reader of their metadata cost a command of ours anything."""
    for package, command in (("greetings", "greet"), ("bystander", "wave")):
        install(package, f"print('{package} is imported')\n{GOOD}", **{command: f"{package}:command"})
    ours = astb("report", "--help", options=("-X", "importtime"))
    assert "click" in ours.stderr, "the trace is read rightly"
    assert "importlib.metadata" not in ours.stderr and "is imported" not in ours.stdout
    assert astb("greet").stdout == "greetings is imported\nhello\n"
    assert "is imported" not in astb("--help").stdout


@pytest.mark.parametrize(
    ("source", "target", "reason"),
    [
        ("import nowhere", "broken:command", "ModuleNotFoundError: No module named 'nowhere'"),
        ("raise SystemExit('I leave')", "broken:command", "SystemExit: I leave"),
        ("", "broken:command", "AttributeError: module 'broken' has no attribute 'command'"),
        ("command = = 5", "broken:command", "SyntaxError"),
        ("command = 5", "broken:command", "is of type int: its entry point must name a click.Command"),
    ],
)
def test_a_broken_command_is_reported_and_the_others_work(
    install: Install, astb: Astb, source: str, target: str, reason: str
) -> None:
    install("broken", source, greet=target)
    install("sound", GOOD, wave="sound:command")
    listed = astb("--help")
    assert (listed.returncode, listed.stderr) == (PASS, "")
    assert re.search(r"^  wave +sound 1\.2$", listed.stdout, re.MULTILINE)
    assert astb("wave").stdout == "hello\n"
    for arguments in ((), ("--help",), ("--what", "7")):
        done = astb("greet", *arguments)
        assert (done.returncode, done.stdout) == (MISUSE, "")
        assert "broken:command of package broken 1.2" in done.stderr and reason in done.stderr
        assert "Traceback" not in done.stderr


def test_one_name_has_one_owner(install: Install, astb: Astb) -> None:
    """Ours go first; of two indistinguishable others, neither is run."""
    for package in ("first", "second"):
        install(package, GOOD, greet=f"{package}:command", plans=f"{package}:command")
    listed = astb("--help").stdout
    assert re.search(r"^  greet +first 1\.2 and second 1\.2$", listed, re.MULTILINE)
    assert re.search(r"^  plans +first 1\.2 and second 1\.2: cannot be used", listed, re.MULTILINE)
    assert "leak_down" in astb("plans").stdout
    refused = astb("greet")
    owners = "first:command of package first 1.2 and second:command of package second 1.2"
    assert refused.returncode == MISUSE
    assert f"{owners} have the same command name greet" in refused.stderr


@pytest.mark.slow
def test_the_example_of_the_how_to_runs(install: Install, astb: Astb, tmp_path: Path) -> None:
    blocks = re.findall(r"^```(?:python|toml)\n(.*?)^```", HOW_TO.read_text(), re.MULTILINE | re.DOTALL)
    (code,) = (one for one in blocks if "spread_command(" in one)
    (text,) = (one for one in blocks if "[project]" in one)
    project = tomllib.loads(text)
    (module,) = project["tool"]["setuptools"]["py-modules"]
    install(module, code, **project["project"]["entry-points"]["astb.commands"])
    done = astb("spread", "leak_down", "--rigs", "2")
    assert done.returncode == PASS, done.stderr
    spreads = re.findall(r"^(.+): (\S+) to (\S+) (\S*)$", done.stdout, re.MULTILINE)
    assert spreads and any(float(low) < float(high) for _, low, high, _ in spreads), done.stdout
    assert (tmp_path / "runs" / "spread" / "rig-1" / "leak_down" / "report.html").exists()
    unknown = astb("spread", "nothing")
    assert unknown.returncode == MISUSE and "there is no plan 'nothing'" in unknown.stderr
