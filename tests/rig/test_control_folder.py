"""Neither side trusts a folder of control sockets of another user."""

import os
import socket
import threading

import pytest
from click.testing import CliRunner

from astb.cli import commands
from astb.exit_codes import BLOCKED
from astb.live.door import NoRun, knock
from bench_protocol.runtime.own_folder import own_directory
from bench_sim.rig.control_socket import ask, control_path
from tests.refusals import refuses


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = tmp_path / "astb"
    own_directory(folder)
    return folder


@pytest.fixture
def false_rig(folder):
    """A program that answers instead of the rig, and its received requests."""
    received = []
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(control_path("127.0.0.1", 15020)))
        listening.listen()
        listening.settimeout(5)

        def answer():
            try:
                connection, _ = listening.accept()
            except OSError:
                return
            with connection:
                received.append(connection.recv(4096))
                connection.sendall(b'{"on":[],"off":[]}\n')

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        yield received


def open_to_others(folder):
    folder.chmod(0o777)


def readable_by_others(folder):
    folder.chmod(0o750)


def of_somebody_else(folder):
    if os.getuid():
        pytest.skip("needs root")
    os.chown(folder, 12345, -1)


def moved_away(folder):
    folder.rename(folder.with_name("real"))
    folder.symlink_to(folder.with_name("real"))


@pytest.mark.parametrize("made", [open_to_others, readable_by_others, of_somebody_else, moved_away])
def test_an_unsafe_folder_is_not_used(folder, false_rig, made):
    made(folder)
    path = control_path("127.0.0.1", 15020)
    with refuses(PermissionError, "enter"):
        ask(path, b'{"do":"list"}')
    with refuses(PermissionError, "enter"):
        own_directory(folder)
    done = CliRunner().invoke(commands, ["rig", "fault", "off", "all"], standalone_mode=False)
    assert done.return_value == BLOCKED or getattr(done.exception, "exit_code", None) == BLOCKED
    assert "only this user can enter" in done.output
    with pytest.raises(NoRun):
        knock(folder / "rig.toml", {"do": "stop"})
    assert false_rig == []


def test_it_answers_in_a_private_folder(folder, false_rig):
    assert b'"off"' in ask(control_path("127.0.0.1", 15020), b'{"do":"list"}')
    assert false_rig
