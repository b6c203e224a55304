"""The script that brings SocketCAN to machines without it: its exit statuses are its contract."""

import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "tools" / "with_vcan.sh"
NO_SOCKETCAN, TIME_LIMIT = 125, 124


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(SCRIPT), *arguments], capture_output=True, text=True, timeout=100, check=False)


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
