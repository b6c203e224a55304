"""Effects given to a simulated rig: seen on the wires, named in the record or sealed, refused in words."""

import json
import re
from contextlib import ExitStack

import numpy as np
import pytest

from astb.exit_codes import FAIL, MISUSE, PASS
from bench_protocol.clock import RealClock
from bench_protocol.units import bar, s
from bench_records.record import read
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters.model_file import Model, write_model
from drivers.bench import Bench
from drivers.can_port import open_can
from drivers.modbus_port import open_modbus
from drivers.wiring.own import own_wiring

ANYWHERE = ("--can", "tcp", "--can-port", "0", "--modbus-port", "0")
VIRTUAL = 'name = "virtual"\ntime = "virtual"\n[simulation]\n'
LEAK = {"leak.left": {"area": 1e-6}}
SEALED = '[effect."leak.left"]\narea = "1 mm2"\n'


@pytest.fixture
def cli(astb_here, tmp_path):
    """Run ``astb`` with arguments in an empty directory: exit code, stdout, stderr."""
    return lambda *arguments: astb_here(tmp_path, *arguments)


@pytest.mark.slow
def test_a_leak_is_seen_over_sockets(start_rig):
    """Through A = 20 mm² flows G = 0.6847 A p φ(r)/√(RT), and V dp/dt = −n RT G with n from 1 to 1.4.

    V is 100 litre at design height and 84 on the emergency springs; the other spring only cools after its filling.
    """
    rig = start_rig(*ANYWHERE, "--effect", "leak.left=20mm2")
    clock = RealClock()
    with ExitStack() as stack:
        modbus = open_modbus("127.0.0.1", rig.modbus_port, timeout=2.0)
        stack.callback(modbus.close)
        can = open_can("tcp", port=rig.can_port)
        stack.callback(can.close)
        bench = Bench(own_wiring(can, modbus), clock)
        stack.callback(bench.close)
        bench.connect()
        bench.arm()
        bench.vertical.hold_position()
        bench.air.fill(to=1.0 * bar, tolerance=0.4 * bar)
        bench.air.hold()
        before = bench.left.bellows_pressure, bench.right.bellows_pressure
        bench.wait(3 * s)
        after = bench.left.bellows_pressure, bench.right.bellows_pressure
    left, right = (was - now for was, now in zip(before, after, strict=True))
    p = 0.5 * (before[0] + after[0]) + 1.013 * bar
    r = 1.013 * bar / p
    phi = np.sqrt(1.0 - (max(r - 0.5, 0.0) / 0.5) ** 2)
    isothermal = 3.0 * 0.6847 * 20e-6 * p * phi * np.sqrt(287.0 * 293.0) / 0.1
    assert 0.9 * isothermal < left - right < 1.4 / 0.84 * 1.1 * isothermal, (left, right, isothermal)
    assert right < 0.2 * left


class Runs:
    """The same plan on rigs with the same seed: healthy, with a leak by option, by rig file, by model, and sealed."""

    def __init__(self, astb_here, directory) -> None:
        self.directory = directory
        (directory / "rig.toml").write_text(VIRTUAL)
        (directory / "leaking.toml").write_text(VIRTUAL + '[simulation.effects]\n"leak.left" = "1 mm2"\n')
        (directory / "hidden.toml").write_text(SEALED)
        write_model(directory / "extended.toml", Model("astb", effects=LEAK))
        self.code, self.said = {}, {}
        for name, options in {
            "healthy": ("--rig", "rig.toml"),
            "option": ("--rig", "rig.toml", "--effect", "leak.left=1mm2"),
            "file": ("--rig", "leaking.toml"),
            "model": ("--rig", "rig.toml", "--model", "extended.toml"),
            "sealed": ("--rig", "rig.toml", "--sealed", "hidden.toml"),
        }.items():
            code, out, err = astb_here(directory, "run", "leak_down", "--seed", 5, "--out", name, *options)
            self.code[name], self.said[name] = code, out + err

    def meta(self, name: str) -> dict:
        return json.loads((self.directory / name / "leak_down" / "meta.json").read_text())

    def bytes(self, name: str) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (self.directory / name / "leak_down").iterdir()}

    def pressure(self, name: str, side: str) -> np.ndarray:
        return read(self.directory / name / "leak_down").series(f"{side}.bellows_pressure")[1]


@pytest.fixture(scope="module")
def runs(astb_here, tmp_path_factory) -> Runs:
    return Runs(astb_here, tmp_path_factory.mktemp("effects"))


@pytest.mark.slow
def test_a_leak_fails_the_leak_down_of_its_side(runs):
    assert runs.code == {"healthy": PASS, "option": FAIL, "file": FAIL, "model": FAIL, "sealed": FAIL}, (
        runs.said
    )
    result = json.loads(runs.bytes("option")["result.json"])
    bad = [check["name"] for check in result["checks"] if check["verdict"] == "fail"]
    assert bad and all("left" in name for name in bad)
    np.testing.assert_allclose(
        runs.pressure("option", "right")[-1], runs.pressure("healthy", "right")[-1], atol=2e3
    )


@pytest.mark.slow
def test_however_it_is_given_it_is_the_same_leak(runs):
    for side in ("left", "right"):
        expected = runs.pressure("option", side)
        for name in ("file", "model", "sealed"):
            np.testing.assert_array_equal(runs.pressure(name, side), expected, err_msg=name)
    assert runs.bytes("file")["record.parquet"] == runs.bytes("option")["record.parquet"]


@pytest.mark.slow
def test_the_record_names_set_and_effects(runs):
    for name, parameters in (("option", "astb"), ("file", "astb"), ("model", "extended")):
        meta = runs.meta(name)["parameters"]
        assert meta["name"] == parameters
        assert meta["effects"] == {"leak.left": {"area": pytest.approx(1e-6)}}
        assert meta["sha256"] != runs.meta("healthy")["parameters"]["sha256"]
    assert "effects" not in runs.meta("healthy")["parameters"]


@pytest.mark.slow
def test_sealed_effects_are_shown_in_no_output(runs):
    """Files and screen equal those of the healthy rig, except for the measured values."""
    for key, fact in runs.meta("healthy").items():
        if key not in ("duration_s", "events", "samples"):
            assert runs.meta("sealed")[key] == fact, key
    said = runs.said["sealed"]
    for name, content in (*runs.bytes("sealed").items(), ("screen", said.encode())):
        for trace in (b"leak.left", b" mm2"):  # with its space: the data of plots have any three letters
            assert trace not in content, name
        # The library that draws the report prints it; bars of checks are hidden from screen readers.
        usual, found = (
            one.replace(b"aria-hidden", b"").count(b"hidden")
            for one in (runs.bytes("healthy").get(name, b""), content)
        )
        assert found == usual, name


def test_the_list_of_effects_names_every_one(cli):
    code, out, err = cli("list", "effects")
    assert (code, err) == (PASS, "")
    assert [line.split()[0] for line in out.splitlines() if not line.startswith(" ")] == list(CATALOGUE)
    places = {f"{one.name}.{place}" for one in CATALOGUE.values() for place in one.places}
    assert places <= set(re.findall(r"[\w.]+", out))


BAD_OPTIONS = {
    "--effect leak.left": "--effect leak.left has no value; write NAME=VALUE, such as leak.left=0.2mm2",
    "--effect leek.left=1mm2": "leek.left is not an effect; did you mean 'leak.",
    "--effect leak=1mm2": "leak is not an effect; did you mean 'leak.",
    "--effect leak.left=1bar": "leak.left: area = '1bar' has a missing or wrong unit; use m2 or mm2 or cm2",
    "--effect leak.left=900mm2": "leak.left: area = 900 mm2 is outside 0 mm2 to 20 mm2",
    "--effect heat=1% --effect heat=2%": "--effect heat is given twice",
    "--effect": "Option '--effect' requires an argument",
    "--model atsb": "no parameter set 'atsb': ",
    "--model nowhere.toml": "no parameter set 'nowhere.toml': No such file or directory; check the path",
    "--model rig.toml": "rig.toml: name is outside a section; move it into a [section]",
    "--sealed nowhere": "no file of effects 'nowhere': No such file",
    "--sealed rig.toml": "rig.toml: the file has name, simulation; use [effect.NAME] tables only",
    "--sealed hidden.toml --effect leak.left=1mm2": "leak.left is already in astb; give it only once",
}


@pytest.mark.parametrize("command", ["run aw0 --virtual", "rig --can tcp --can-port 0 --modbus-port 0"])
@pytest.mark.parametrize(("options", "reason"), BAD_OPTIONS.items())
def test_bad_options_are_refused_in_words(cli, tmp_path, command, options, reason):
    (tmp_path / "rig.toml").write_text('name = "x"\n[simulation]\n')
    (tmp_path / "hidden.toml").write_text(SEALED)
    code, out, err = cli(*command.split(), "--rig", "rig.toml", *options.split())
    assert (code, out) == (MISUSE, "")
    assert reason in err
    lines = err.strip().splitlines()
    assert len(lines) == 1 or lines[-1].startswith("Error: ")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ('"leak.left" = "1 bar"', "leak.left: area = '1 bar' has a missing or wrong unit; use m2"),
        ('"leak.left" = 1', "leak.left: area = '1' has a missing or wrong unit; use m2"),
        ('leek = "1 mm2"', "leek is not an effect"),
        ('leak = { left = "1 mm2" }', "leak is not an effect; did you mean 'leak."),
    ],
)
def test_bad_effects_in_a_rig_file_are_refused_in_words(cli, tmp_path, table, reason):
    (tmp_path / "rig.toml").write_text(f'name = "x"\n[simulation.effects]\n{table}\n')
    code, out, err = cli("run", "aw0", "--virtual", "--rig", "rig.toml")
    assert (code, out) == (MISUSE, "")
    assert reason in err


@pytest.mark.parametrize(
    "option", [("--effect", "heat=1%"), ("--model", "astb"), ("--sealed", "hidden.toml")]
)
@pytest.mark.parametrize("command", [("run", "aw0"), ("rig",)])
def test_a_real_rig_accepts_no_effects(cli, tmp_path, command, option):
    (tmp_path / "hall.toml").write_text('name = "hall"\n')
    code, _, err = cli(*command, "--rig", "hall.toml", *option)
    assert code == MISUSE
    assert "hall.toml describes a real rig (no [simulation] table)" in err


@pytest.mark.slow
def test_a_running_rig_keeps_its_effects(cli, start_rig, tmp_path):
    rig = start_rig(*ANYWHERE)
    ports = f'[can]\nbus = "tcp"\nport = {rig.can_port}\n[modbus]\nport = {rig.modbus_port}\n'
    (tmp_path / "rig.toml").write_text(f'name = "x"\n{ports}[simulation]\n')
    code, _, err = cli("run", "aw0", "--rig", "rig.toml", "--effect", "heat=1%")
    assert code == MISUSE
    assert f"other effects is running at 127.0.0.1:{rig.modbus_port} already" in err
