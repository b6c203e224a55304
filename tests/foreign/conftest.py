"""The strangers as processes of their own, and rig files with the addresses at which they are."""

import select
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.foreign import wiring_file

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PROGRAMS = {
    "plant_a": "tests.foreign.plc_rig",
    "hall_b": "tests.foreign.can_rig",
    "yard_c": "tests.foreign.yard_rig",
}
#: Modbus ports that the wirings name.
PORTS = {"plant_a": "port = 1502", "yard_c": "port = 1503"}
START_LIMIT = 60  # s: for a busy machine and a model that is not compiled yet


@contextmanager
def running(name, *arguments):
    """Start a third-party rig and return the address that it prints; it ends when its input does."""
    command = [sys.executable, "-m", PROGRAMS[name], *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=ROOT) as process:
        try:
            assert select.select([process.stdout], [], [], START_LIMIT)[0], "it does not start"
            line = process.stdout.readline()
            assert line.startswith("ready "), line
            yield line.partition("=")[2].strip()
        finally:
            process.stdin.close()
            try:
                process.wait(5)
            finally:
                process.kill()


def write_files(name, address, directory):
    """Write the folder of a rig, found at ``address``, into ``directory``; return its rig file."""
    host, _, port = address.removeprefix("socketcand://").partition(":")
    folder = Path(shutil.copytree(HERE / name, directory / name))
    wiring = wiring_file(name).read_text()
    if name in PORTS:
        assert PORTS[name] in wiring
        wiring = wiring.replace(PORTS[name], f"port = {port}")
    else:
        assert 'bus = "can0"' in wiring
        wiring = wiring.replace(
            'bus = "can0"', f'bus = "tcp"\nhost = "{host}"\nport = {port}' if port else f'bus = "{host}"'
        )
    (folder / "wiring.toml").write_text(wiring)
    return folder / "rig.toml"


@pytest.fixture
def started(tmp_path):
    """Start a strange rig: ``with started(name) as (rig file, address)``."""

    @contextmanager
    def start(name, *arguments):
        with running(name, *arguments) as address:
            yield write_files(name, address, tmp_path), address

    return start


@pytest.fixture
def wired():
    """Write the files of a rig that is found at some address: ``wired(name, address, directory)``."""
    return write_files
