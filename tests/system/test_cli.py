"""The command line as a user meets it: what it answers, how it ends, what it leaves behind, how it refuses."""

import csv
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import cantools
import pytest

from astb.exit_codes import BLOCKED, MISUSE, PASS
from bench_protocol.named_files import named_files
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from drivers.can_port import open_can
from drivers.modbus_port import open_modbus

HEAVY = ("numba", "scipy", "pandas", "pyarrow", "matplotlib", "can", "pymodbus")
RIG = '[can]\nbus = "tcp"\nport = {can}\n[modbus]\nport = {modbus}\n'
TRACEBACK = "Traceback"


@pytest.fixture
def cli(astb_here, tmp_path):
    """Run ``astb`` with arguments in an empty directory: exit code, stdout, stderr."""
    return lambda *arguments: astb_here(tmp_path, *arguments)


@pytest.fixture
def closed_port() -> int:
    """A port of the loopback without a server."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def processes_below(pid: int) -> list[int]:
    """Return the processes that ``pid`` has started and that are still there."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            found.append(int(stat.parent.name))
    return found


# -- quick answers -----------------------------------------------------------------------------------------------------


def imported_by(*arguments: str) -> set[str]:
    """Run ``astb`` and return the modules that it has imported."""
    traced = [sys.executable, "-X", "importtime", "-m", "astb", *arguments]
    done = subprocess.run(traced, capture_output=True, text=True, check=True)
    imported = set(re.findall(r"\|\s+([\w.]+)$", done.stderr, re.MULTILINE))
    assert "click" in imported, "the trace is read rightly"
    return imported


@pytest.mark.parametrize("command", ["--help", "plans", "rig signals", "list effects", "run --help"])
def test_light_commands_import_no_heavy_modules(command):
    assert imported_by(*command.split()).isdisjoint(HEAVY)


def test_the_list_of_the_commands_imports_none_of_them():
    """Nor what reads the metadata of packages: that alone takes as long as all the rest."""
    imported = imported_by("--help")
    ours = {name for name in imported if name.startswith(("astb.commands.", "bench_", "campaigns"))}
    assert ours == {"bench_protocol", "bench_protocol.runtime"}
    assert "importlib.metadata" not in imported


@pytest.mark.slow
def test_a_virtual_run_and_its_report_import_only_what_they_use(tmp_path):
    imported = imported_by("run", "aw0", "--virtual", "--out", str(tmp_path))
    assert {"numba", "pyarrow", "pymodbus"} <= imported
    assert imported.isdisjoint({"pandas", "scipy.linalg", "can", "matplotlib", "pyarrow.compute"})


@pytest.mark.real_time
def test_help_comes_at_once():
    """Compared with an empty interpreter, in the same minute: twice to three times as long is usual."""

    def best(*arguments: str) -> float:
        times = []
        for _ in range(3):
            start = time.perf_counter()
            subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, check=True)
            times.append(time.perf_counter() - start)
        return min(times)

    assert best("-m", "astb", "--help") < 6 * best("-c", "pass")


# -- the rig as a process ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_an_interrupted_rig_leaves_no_files_behind(start_rig, how):
    """With a commander and a listener connected, who are the ones that keep ports busy."""
    rig = start_rig()
    assert re.fullmatch(
        r"ready can=socketcand://127\.0\.0\.1:\d+ modbus=127\.0\.0\.1:\d+ control=/\S+", rig.ready
    )
    can = open_can("tcp", port=rig.can_port)
    modbus = open_modbus("127.0.0.1", rig.modbus_port)
    assert modbus.read_input(1, 2) == [TABLE.map_hash >> 16, TABLE.map_hash & 0xFFFF]
    assert processes_below(rig.process.pid) == []
    rig.send_signal(how)
    out, complaints = rig.process.communicate(timeout=10)
    told = f"astb: the rig was ended by {how.name}\n" if how in {signal.SIGHUP, signal.SIGQUIT} else ""
    assert (rig.process.returncode, out, complaints) == (PASS, "", told)
    assert not Path(rig.ready.partition("control=")[2]).exists()
    can.close()
    modbus.close()
    for port in (rig.can_port, rig.modbus_port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port), timeout=1)
        socket.create_server(("127.0.0.1", port)).close()  # the next one gets the port at once


@pytest.mark.real_time
@pytest.mark.parametrize("wire", ["CAN", "Modbus"])
def test_a_port_in_use_is_named(cli, rig_file, wire):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        ports = {"CAN": (port, 0), "Modbus": (0, port)}[wire]
        options = ("--can", "tcp", "--can-port", ports[0], "--modbus-port", ports[1])
        code, out, err = cli("rig", "--rig", rig_file, *options)
    assert (code, out) == (BLOCKED, "")
    assert err.startswith(f"astb: {wire} port {port} on 127.0.0.1 cannot be opened: ")
    assert "address already in use" in err


def test_a_can_interface_that_is_not_there_is_named(cli, rig_file):
    code, out, err = cli("rig", "--rig", rig_file, "--can", "can17", "--modbus-port", "0")
    assert (code, out) == (BLOCKED, "")
    assert err.startswith("astb: CAN interface can17 cannot be opened: ")


# -- what a user can type ----------------------------------------------------------------------------------------------

BAD_FILES = {
    "name = ": "is not TOML: line 1, name =: the value is not valid; write a number",
    'description = "no name"': "the key name is missing",
    'name = "x"\n[simulaton]': "simulaton is not a key here; did you mean 'simulation'?",
    'name = "x"\n[can]\nprot = 1\n[simulation]': "can.prot is not a key here; did you mean 'port'?",
    "name = 3\n[simulation]": "name = 3; use a text",
    'name = "x"\ncan = 3': "can = 3; use a table of keys",
    'name = "x"\n[can]\nport = 70000\n[simulation]': "can.port = 70000; use a whole number <= 65535",
    'name = "x"\n[modbus]\nport = 0\n[simulation]': "modbus.port = 0; use a whole number >= 1",
    'name = "x"\n[modbus]\nunit = "1"\n[simulation]': "modbus.unit = '1'; use a whole number",
    'name = "x"\ntime = "slow"\n[simulation]': 'time = \'slow\'; use "real" or "virtual"',
    'name = "x"\ntime = "virtual"': "time = virtual needs a [simulation] table",
    'name = "x"': "there is no [simulation] table; virtual time needs one",
    'name = "x"\n[simulation]\nseed = -1': "simulation.seed = -1; use a whole number >= 0",
    'name = "x"\n[simulation]\nseed = 99999999999999999999': "simulation.seed with an integer of more than 64 bits",
    'name = "x"\n[simulation]\nlate_ticks = "drop"': 'drop\'; use "catch_up" or "skip" or "fault"',
    'name = "x"\n[simulation]\nfaults = [{ name = "a", values = { b = [1] } }]': "values.b = [1]; use a number or a",
    'name = "x"\n[simulation]\nparameters = "atsb"': "no parameter set 'atsb'",
}
BAD_CHANGES = {
    'orifice_diameter = "18 cm"': "orifice_diameter[0] = 180 mm is outside 1 to 100 mm",
    'orifice_diameter = "18"': "orifice_diameter = '18' has a missing or wrong unit; use m or mm",
    "orifice_diameter = 18": "orifice_diameter = 18 has a missing or wrong unit; use m or mm",
    'orifice_diameter = "wide mm"': "orifice_diameter = 'wide mm' is not a number with its unit; use",
    'sensor_lag = "1 ms"': "sensor_lag = '1 ms' is not a table by sensor, such as { left_height =",
    'orifice_diameter = "900 mm"': "orifice_diameter[0] = 900 mm is outside 1 to 100 mm",
    'orifice_diameter = "nan mm"': "orifice_diameter[0] = nan mm is outside 1 to 100 mm",
    'orifice_diamter = "18 mm"': "orifice_diamter is not a parameter; did you mean 'orifice_diameter'?",
    'dpv_reclosing = "2 bar"': "dpv_reclosing = 200000.0 exceeds dpv_opening = 120000.0 (SI)",
}
BAD_ARGUMENTS = {
    "fly": "No such command 'fly'",
    "run": "Missing argument 'PLAN...'",
    "run aw9 --virtual": "there is no plan 'aw9'; did you mean 'aw3'?",
    "run aw0 --rig nowhere.toml": "rig file nowhere.toml cannot be read: No such file or directory; check the path",
    "run aw0 --virtual --rig .": "there is no rig '.'",
    "run aw0 --specimen nowhere.toml": "specimen nowhere.toml cannot be read: No such file or directory; check the",
    "run aw0 --specimen nobody": "use one of astb, kuzyshyn_2024 (or give a path that ends in .toml)",
    "list specimens nobody": "specimen nobody cannot be read",
    "run aw0 --set amplitude=20mm": "aw0 has no parameter amplitude",
    "run aw0 --set amplitude": "--set amplitude has no value; write NAME=VALUE",
    "run aw0 --set aw3.load=AW0": "aw3.load is a parameter of the plan aw3, but the plans to run are aw0",
    "run aw0 --with nowhere.toml": "--with nowhere.toml cannot be read: No such file",
    "plans aw9": "there is no plan 'aw9'",
    "run aw0 --seed -1": "'--seed': -1 is not in the range 0<=x<=4294967295",
    "run aw0 --seed 99999999999999999999": "'--seed': 99999999999999999999 is not in the range",
    "run aw0 --seed three": "'--seed': 'three' is not a valid integer range",
    "run aw0 --sede 3": "No such option '--sede'",
    "run aw0 --rig locl": "there is no rig 'locl'; did you mean 'local'?",
    "rig --can-port 65536": "'--can-port': 65536 is not in the range 0<=x<=65535",
    "rig --modbus-port x": "'--modbus-port': 'x' is not a valid integer range",
    "report nowhere": "Directory 'nowhere' does not exist",
    "report .": "holds no record.parquet",
    "rig signals --dbc nowhere/astb.dbc": "nowhere/astb.dbc cannot be written: No such file or directory",
    "rig signals --csv .": "File '.' is a directory",
}


def is_one_sentence(err: str) -> bool:
    """Whether an error is the one line of ours, or click's usage lines with one error at their end."""
    lines = err.strip().splitlines()
    return len(lines) == 1 if lines[0].startswith("astb: ") else lines[-1].startswith("Error: ")


@pytest.mark.parametrize(("text", "reason"), BAD_FILES.items())
def test_a_bad_rig_file_is_refused_in_words(cli, tmp_path, text, reason):
    path = write(tmp_path / "bad.toml", text)
    code, out, err = cli("run", "aw0", "--virtual", "--rig", path)
    assert (code, out) == (MISUSE, "")
    assert reason in err
    assert is_one_sentence(err)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(("change", "reason"), BAD_CHANGES.items())
def test_a_bad_change_of_a_parameter_is_refused_in_words(cli, tmp_path, change, reason):
    path = write(tmp_path / "bad.toml", f'name = "x"\n[simulation.change]\n{change}\n')
    for command in (
        ("run", "aw0", "--virtual"),
        ("rig", "--can", "tcp", "--can-port", 0, "--modbus-port", 0),
    ):
        code, out, err = cli(*command, "--rig", path)
        assert (code, out) == (MISUSE, "")
        assert reason in err
        assert is_one_sentence(err)


@pytest.mark.parametrize(("arguments", "reason"), BAD_ARGUMENTS.items())
def test_bad_arguments_are_refused_in_words(cli, arguments, reason):
    code, out, err = cli(*arguments.split())
    assert (code, out) == (MISUSE, "")
    assert reason in err
    assert is_one_sentence(err)
    assert TRACEBACK not in err


def test_a_rig_file_that_is_no_text_is_refused(cli, tmp_path):
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    code, _, err = cli("rig", "--rig", path)
    assert code == MISUSE
    assert "binary.toml is not valid UTF-16-LE" in err
    assert is_one_sentence(err)


def test_an_open_door_to_the_network_must_be_asked_for(cli, tmp_path):
    path = write(tmp_path / "open.toml", 'name = "x"\n[can]\nhost = "0.0.0.0"\n[simulation]\n')
    code, _, err = cli("rig", "--rig", path, "--can", "tcp", "--can-port", 0, "--modbus-port", 0)
    assert code == MISUSE
    assert "host = 0.0.0.0 would open the bench to the network" in err


def test_a_directory_that_cannot_be_written_is_named(cli, tmp_path, rig_file):
    taken = write(tmp_path / "taken", "a file")
    code, _, err = cli("run", "aw0", "--virtual", "--rig", rig_file, "--out", taken)
    assert code == MISUSE
    assert f"the record's folder {taken}/aw0 cannot be written: Not a directory" in err
    assert is_one_sentence(err)


def test_an_error_of_our_own_is_not_taken_for_a_failed_product(cli, monkeypatch, rig_file):
    """Python would end with 1, and 1 says that the product failed."""
    import astb.session

    def broken(*_):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(astb.session, "build_rig", broken)
    code, _, err = cli("rig", "--rig", rig_file)
    assert code == BLOCKED
    assert "ZeroDivisionError: a bug" in err


# -- a real rig --------------------------------------------------------------------------------------------------------


@pytest.fixture
def no_process(monkeypatch):
    """Each start of a process is detected."""

    def refuse(*arguments, **_):
        raise AssertionError(f"a process was started: {arguments}")

    monkeypatch.setattr(subprocess, "Popen", refuse)


@pytest.mark.real_time
def test_a_real_rig_that_does_not_answer_blocks_the_run(cli, tmp_path, closed_port, no_process):
    hall = named_files("rigs")["hall"].read_text()
    assert 'host = "192.0.2.10"\nport = 502' in hall
    path = write(
        tmp_path / "hall.toml",
        hall.replace('host = "192.0.2.10"\nport = 502', f'host = "127.0.0.1"\nport = {closed_port}'),
    )
    start = time.monotonic()
    code, out, err = cli("run", "aw0", "--rig", path)
    assert time.monotonic() - start < 5
    assert (code, out) == (BLOCKED, "")
    assert f"no Modbus device answers at 127.0.0.1:{closed_port}" in err
    assert is_one_sentence(err)


@pytest.mark.slow
@pytest.mark.real_time
def test_a_device_that_never_answers_blocks(cli, tmp_path, no_process):
    with socket.create_server(("127.0.0.1", 0)) as silent, socket.create_server(("127.0.0.1", 0)) as mute:
        ports = {"modbus": silent.getsockname()[1], "can": mute.getsockname()[1]}
        path = write(tmp_path / "silent.toml", 'name = "x"\n' + RIG.format(**ports))
        code, _, err = cli("run", "aw0", "--rig", path)
    assert code == BLOCKED
    assert is_one_sentence(err)


def test_a_real_rig_is_not_simulated(cli, tmp_path):
    path = write(tmp_path / "hall.toml", 'name = "hall"\n')
    code, _, err = cli("rig", "--rig", path)
    assert code == MISUSE
    assert "describes a real rig" in err


# -- for other tools ---------------------------------------------------------------------------------------------------


def test_the_dbc_is_read_by_cantools(cli, tmp_path):
    assert cli("rig", "signals", "--dbc", "astb.dbc", "--csv", "map.csv")[0] == PASS
    database = cantools.database.load_file(tmp_path / "astb.dbc")
    assert {message.frame_id for message in database.messages} == {m.identifier for m in TABLE.messages}
    with (tmp_path / "map.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == len(TABLE.registers)
    named = {row["signal"] for row in rows}
    assert named >= {signal.name for signal in TABLE.of_kind(Kind.SETTING, Kind.ACTION, Kind.MEASUREMENT)}


def test_the_list_of_signals_names_every_one_with_its_range(cli):
    code, out, _ = cli("rig", "signals")
    assert code == PASS
    assert out.startswith(f"map {TABLE.map_hash:08x}\n")
    listed = [line.split()[0] for line in out.splitlines()[1:]]
    assert listed == [signal.name for signal in TABLE.signals]


def test_the_list_of_plans_can_be_cut_by_head(tmp_path):
    """A closed pipe is how half of all lists end, and no reason for a traceback."""
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "astb", "rig", "signals"],
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    os.close(writer)
    assert TRACEBACK not in done.stderr
