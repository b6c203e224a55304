"""The script that brings SocketCAN to machines without it: its exit statuses are its contract."""

import os
import platform
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "tools" / "with_vcan.sh"
CACHE = Path(
    os.environ.get(
        "VCAN_UML_CACHE", Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "vcan-uml"
    )
)
NO_SOCKETCAN, TIME_LIMIT = 125, 124


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(SCRIPT), *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


@pytest.mark.parametrize("arguments", [[], ["--"], ["-x", "--", "true"], ["-t", "soon", "--", "true"]])
def test_misuse_is_2_and_says_why(arguments: list[str]) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert "usage:" in done.stderr or "is not a number of seconds" in done.stderr


def test_a_directory_that_is_not_there_is_named() -> None:
    done = run("-w", "/no/such/directory", "--", "true")
    assert done.returncode == NO_SOCKETCAN
    assert "/no/such/directory" in done.stderr


@pytest.mark.slow
def test_the_command_finds_a_bus_its_words_and_its_status() -> None:
    done = run(
        "-t",
        "60",
        "--",
        "sh",
        "-c",
        'cat /sys/class/net/vcan0/type; echo "$1|$2"; exit 7',
        "sh",
        "a b",
        "$HOME'",
    )
    if done.returncode == NO_SOCKETCAN:
        pytest.skip(f"no SocketCAN on this machine: {done.stderr.strip()}")
    assert done.stdout.split("\n")[:2] == ["280", "a b|$HOME'"]
    assert done.returncode == 7


@pytest.mark.slow
def test_a_command_that_never_ends_is_ended() -> None:
    done = run("-t", "6", "--", "sleep", "100")
    if done.returncode == NO_SOCKETCAN:
        pytest.skip(f"no SocketCAN on this machine: {done.stderr.strip()}")
    assert done.returncode == TIME_LIMIT


@pytest.fixture
def amx(tmp_path: Path) -> str:
    """A library that makes the registers of this machine look like those of one with AMX."""
    if platform.machine() != "x86_64":
        pytest.skip("user-mode Linux exists for x86_64 only")
    done = run("-u", "-t", "60", "--", "true")  # fetches it, where it is not here yet
    if done.returncode == NO_SOCKETCAN:
        pytest.skip(f"no user-mode Linux on this machine: {done.stderr.strip()}")
    library = tmp_path / "amx_kernel.so"
    source = Path(__file__).with_name("amx_kernel.c")
    subprocess.run(
        ["cc", "-O2", "-Wall", "-Werror", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True
    )
    return str(library)


@pytest.mark.slow
def test_user_mode_linux_boots_where_the_processor_has_more_registers_than_it_knows(amx: str) -> None:
    done = run("-u", "-t", "60", "--", "sh", "-c", "echo Checking this; exit 7", LD_PRELOAD=amx)
    assert done.stdout == "Checking this\n"  # nothing of what the kernel says, all that the command says
    assert done.returncode == 7


@pytest.mark.slow
@pytest.mark.parametrize(
    ("compiler", "reason"),
    [("no-such-compiler", "no C compiler no-such-compiler"), ("false", "could not compile")],
)
def test_without_a_compiler_it_shows_why_it_did_not_boot_and_what_is_missing(
    amx: str, compiler: str, reason: str, tmp_path: Path
) -> None:
    cache = tmp_path / "a cache"  # that has the kernel, and nothing compiled yet
    cache.mkdir()
    (cache / "usr").symlink_to(CACHE / "usr")
    done = run("-u", "-t", "60", "--", "true", LD_PRELOAD=amx, CC=compiler, VCAN_UML_CACHE=str(cache))
    assert done.returncode == NO_SOCKETCAN
    assert "ptrace set fp regs failed" in done.stderr
    assert "Kernel panic" in done.stderr
    assert reason in done.stderr
    assert "AMX" in done.stderr
