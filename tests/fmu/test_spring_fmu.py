"""The springs as FMUs: what others simulate is what the plant does, and mistakes come back as a status."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner

from astb.fmu.cli import fmu_command
from astb.fmu.export import platforms, write_unit
from astb.fmu.models.springs import springs
from astb.fmu.unit import Kind
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.layout import INPUTS, Input
from bench_sim.model.plant import Plant
from bench_sim.model.replay import Before, Gas, Motion, replay
from bench_sim.parameters import load
from tests.plain_python import run_plain

pytestmark = pytest.mark.slow

VERSIONS = (2, 3)
MODELS = ("spring", "bench", "car")
HERE = Path(__file__).parent
NAMES = (
    *("left.height", "right.height", "springs.lateral"),
    *("left.height_speed", "right.height_speed", "springs.lateral_speed"),
)
#: Outputs that `alone.py` reads after each step: position and forces.
ATMOSPHERE = 101_325.0
OUTPUTS = (
    (Algebraic.VERTICAL_FORCE, 0.0),
    (Algebraic.VERTICAL_FORCE + 1, 0.0),
    (Algebraic.LATERAL_FORCE, 0.0),
    (Algebraic.ROLL_MOMENT + 1, 0.0),
    (Algebraic.PRESSURE, ATMOSPHERE),
    (Algebraic.AUXILIARY_PRESSURE, ATMOSPHERE),
    (Algebraic.TEMPERATURE, 0.0),
    (Algebraic.ORIFICE_FLOW, 0.0),
    (Algebraic.LEVELING_FLOW, 0.0),
)
#: The same laws in plain Python, one communication step after the other.
TWIN = """
import sys
import numpy as np
from astb.fmu.kernels.springs import OUTPUTS, ROWS, advance, start
from bench_sim.model.layout import INPUTS, STATES, Input
from bench_sim.model.quantities import MEMORY, PARAMETERS
from bench_sim.parameters import load

def run():
    given = np.load(FILE)
    every = []
    for ticks in (1, 5, 20):
        motion = np.pad(given["motion"][::ticks], ((0, 0), (0, 3)))  # without accelerations
        parameters = np.array([load().record], PARAMETERS).view(np.recarray)
        memory = np.zeros(1, MEMORY).view(np.recarray)
        x, u, work, out = np.zeros(STATES), np.zeros(INPUTS), np.zeros((ROWS, STATES)), np.zeros(OUTPUTS)
        u[[Input.SUPPLY, Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE, Input.DPV_CONNECTED]] = 1.0
        start(x, memory, u, parameters, np.zeros(9), 1.0, work, out)
        for row in motion[:-1]:
            advance(x, memory, u, parameters, row, 0.0, 1e-3, ticks, work, out)
            every.append(out.copy())
    return np.array(every)
"""


def looked_at(rows: np.ndarray) -> np.ndarray:
    """Return what the FMU's outputs should be, from rows of algebraic quantities."""
    return np.stack([rows[:, place] - less for place, less in OUTPUTS], axis=1)


def equal(found: np.ndarray, right: np.ndarray, within: float) -> bool:
    """Whether all are the same within this share of the range over which they go, or of their size if that is more."""
    size = np.maximum(np.abs(right).max(axis=0), np.ptp(right, axis=0)) + 1e-12
    return bool((np.abs(found - right) <= within * size).all())


@pytest.fixture(scope="module")
def ridden() -> tuple[np.ndarray, np.ndarray]:
    """A bench at AW0 shaken in all directions for 200 ticks: motion of its springs, and their forces."""
    plant = Plant.at_rest(load().record)
    rest = plant.inputs.copy()
    motion, rows = [], []
    for _ in range(201):
        phase = 2.0 * np.pi * 3.0 * plant.time
        plant.inputs[Input.VERTICAL_LEFT_COMMAND] = rest[Input.VERTICAL_LEFT_COMMAND] + 6e3 * np.sin(phase)
        plant.inputs[Input.VERTICAL_RIGHT_COMMAND] = rest[Input.VERTICAL_RIGHT_COMMAND] + 4e3 * np.sin(
            3 * phase
        )
        plant.inputs[Input.LATERAL_COMMAND] = 3e3 * np.sin(2 * phase)
        plant.ideal()
        out = plant._algebraic.copy()
        places = Algebraic.HEIGHT, Algebraic.HEIGHT + 1, Algebraic.LATERAL
        speeds = Algebraic.HEIGHT_SPEED, Algebraic.HEIGHT_SPEED + 1, Algebraic.LATERAL_SPEED
        motion.append([out[place] for place in (*places, *speeds)])
        rows.append(out)
        plant.step()
    return np.array(motion), np.array(rows)


@pytest.mark.parametrize("version", VERSIONS)
def test_another_tool_finds_no_fault(spring_fmus, isolated, version):
    assert isolated(spring_fmus[version], "validate") == {"problems": [], "version": f"{version}.0"}
    with zipfile.ZipFile(spring_fmus[version]) as archive:
        assert b"Apache License" in archive.read("documentation/licenses/license.txt")
        assert b"design height" in archive.read("documentation/index.html")
        description = ElementTree.fromstring(archive.read("modelDescription.xml"))
    tag = "Float64" if version == 3 else "ScalarVariable"
    area = next(one for one in description.iter(tag) if one.get("name") == "left.effective_area")
    number = area if version == 3 else area[0]
    assert (area.get("variability"), number.get("unit"), number.get("start")) == ("tunable", "m2", "0.26")
    assert (number.get("min"), number.get("max")) == ("0.1", "0.5")
    assert area.get("description").startswith("effective area; assumed: effective diameter 575 mm")


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", MODELS)
def test_the_library_does_not_link_python(spring_fmus, bench_fmus, car_fmus, tmp_path, name, version):
    fmu = {"spring": spring_fmus, "bench": bench_fmus, "car": car_fmus}[name][version]
    with zipfile.ZipFile(fmu) as archive:
        (library,) = (one for one in archive.namelist() if one.endswith(".so"))
        archive.extract(library, tmp_path)
    linked = subprocess.run(["ldd", tmp_path / library], capture_output=True, text=True, check=True).stdout
    assert {line.split()[0].split("/")[-1].split(".")[0] for line in linked.splitlines()} <= {
        *("linux-vdso", "libm", "libc", "ld-linux-x86-64", "ld-linux-aarch64"),
    }
    said = subprocess.run(["nm", "-D", tmp_path / library], capture_output=True, text=True, check=True).stdout
    symbols = [line.split()[-1] for line in said.splitlines()]
    assert not [one for one in symbols if one.startswith(("Py", "_Py", "numba", "NRT"))]
    ours = [line.split()[-1] for line in said.splitlines() if line.split()[-2] in "TW"]
    assert all(one.startswith(f"fmi{version}") for one in ours), "only functions of FMI are seen from outside"


def test_the_spring_fmu_equals_the_laws(spring_fmus, isolated, ridden, tmp_path):
    """Within 1e-12 of plain Python, for steps of 1, 5 and 20 ms, also when saved and gone on with in another one."""
    motion, rows = ridden
    np.savez(tmp_path / "motion.npz", motion=motion)
    twin = run_plain(TWIN.replace("FILE", repr(str(tmp_path / "motion.npz"))), tmp_path)
    right = looked_at(twin)
    first = 0
    for ticks in (1, 5, 20):
        steps = 200 // ticks
        times = 1e-3 * ticks * np.arange(steps + 1)
        for version in VERSIONS if ticks == 5 else (2,):
            got = isolated(spring_fmus[version], "motion", names=NAMES, times=times, motion=motion[::ticks])
            assert got["outputs"] == got["again"], "saved and restored"
            assert equal(np.array(got["outputs"]), right[first : first + steps], 1e-12)
        if (
            ticks == 1
        ):  # and it is the bench: what lies between is half an acceleration times a square of 1 ms
            assert equal(np.array(got["outputs"])[:, :6], looked_at(rows)[1:, :6], 1e-3)
        first += steps


#: A jump of both springs by 5 mm up: volume and absolute pressure of each bellows before and after.
JUMP = """
import sys
import numpy as np
from astb.fmu.kernels.springs import OUTPUTS, ROWS, advance, start
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.layout import INPUTS, STATES
from bench_sim.model.quantities import MEMORY, PARAMETERS
from bench_sim.parameters import load

def run():
    parameters = np.array([load().record], PARAMETERS).view(np.recarray)
    memory = np.zeros(1, MEMORY).view(np.recarray)
    x, u, work, out = np.zeros(STATES), np.zeros(INPUTS), np.zeros((ROWS, STATES)), np.zeros(OUTPUTS)
    motion, found = np.zeros(9), []
    start(x, memory, u, parameters, motion, 1.0, work, out)
    for height in (0.0, 5e-3, 0.0):
        motion[:2] = height
        advance(x, memory, u, parameters, motion, 0.0, 1e-3, 0, work, out)
        found.append([out[Algebraic.VOLUME + i] for i in range(2)] + [out[Algebraic.PRESSURE + i] for i in range(2)])
    return np.array(found)
"""


def test_gas_does_the_work_of_a_jump(tmp_path):
    """A step of a displacement is an adiabate, p V^γ = const., and leads back to where it came from."""
    V, p = np.split(run_plain(JUMP, tmp_path), 2, axis=1)
    gamma = float(load().record.heat_capacity_ratio)
    assert V[1, 0] > 1.01 * V[0, 0]
    assert p[1] * V[1] ** gamma == pytest.approx(p[0] * V[0] ** gamma, rel=1e-4)
    assert p[2] == pytest.approx(p[0], rel=1e-6)


def test_springs_that_are_moved_by_jumps_are_as_stiff(spring_fmus, isolated):
    """Who gives places and no speeds has the forces of who gives both, but for the half step that jumps come late."""
    t = 1e-3 * np.arange(400)
    height, speed = 4e-3 * np.sin(10.0 * t), 0.04 * np.cos(10.0 * t)
    names = ["left.height", "right.height"]
    jumping = isolated(
        spring_fmus[3], "motion", names=names, times=t, motion=np.stack([height, height], axis=1)
    )
    names += ["left.height_speed", "right.height_speed"]
    rows = np.stack([height, height, speed, speed], axis=1)
    moving = isolated(spring_fmus[3], "motion", names=names, times=t, motion=rows)
    found, right = (np.array(one["outputs"])[:, 0] for one in (jumping, moving))
    assert np.ptp(found) == pytest.approx(np.ptp(right), rel=0.01)
    assert np.abs(found - right).max() < 0.02 * np.ptp(right)


def test_the_fmu_equals_a_replay_at_constant_speed(spring_fmus, isolated):
    """`replay` takes another road: cubics between samples, which a constant speed makes straight."""
    n = 301
    speeds = np.array([0.03, -0.02, 0.05])
    times = 1e-3 * np.arange(n)
    parameters = load().record
    stretched = times[:, None] * speeds
    roll = 0.5 * (stretched[:, 0] - stretched[:, 1]) / parameters.spring_half_spacing
    displacement = np.zeros((n, 6))
    displacement[:, 0] = stretched[:, 2] - parameters.centre_height * roll
    displacement[:, 1] = 0.5 * (stretched[:, 0] + stretched[:, 1])
    displacement[:, 2] = roll
    p = parameters.nominal_preload[0] / parameters.effective_area[0] + parameters.atmospheric_pressure
    inputs = np.zeros((n, INPUTS))
    inputs[
        :, [Input.SUPPLY, Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE, Input.DPV_CONNECTED]
    ] = 1.0
    rows = np.empty((n, ALGEBRAICS))
    supply = np.full(n, parameters.supply_pressure + parameters.atmospheric_pressure)
    gas = Gas(np.full(4, p), np.full(4, parameters.ambient_temperature))
    motion = Motion.through(displacement, 1e-3)
    replay(parameters, motion, inputs, supply, gas, step=1e-3, before=Before.at_rest(), rows=rows)
    given = np.hstack((stretched, np.broadcast_to(speeds, stretched.shape)))
    got = isolated(spring_fmus[3], "motion", names=NAMES, times=times, motion=given)
    assert equal(np.array(got["outputs"]), looked_at(rows)[1:], 1e-9)


def test_a_hundred_of_them_do_not_meet(spring_fmus, isolated):
    got = isolated(spring_fmus[2], "many")
    assert got["forces"][63] == got["alone"]
    assert len(set(got["forces"])) == 100


@pytest.mark.parametrize("version", VERSIONS)
def test_the_rest_of_a_tick_is_kept_for_the_next_step(spring_fmus, isolated, version):
    got = isolated(spring_fmus[version], "remainder")
    assert equal(np.array(got["parts"])[None], np.array(got["whole"])[None], 1e-12)


@pytest.mark.parametrize("version", VERSIONS)
def test_invalid_values_give_a_status_and_a_message(spring_fmus, isolated, version):
    got = isolated(spring_fmus[version], "refusals")
    assert got["range"] == ["left.effective_area = 3 m2 is outside 0.1 to 0.5 m2"]
    assert got["kept"] == [0.26]
    assert got["nan"] == ["left.height = nan m is outside -0.3 to 0.3 m"]
    assert got["output"] == ["left.vertical_force is calculated and cannot be set"]
    assert got["fixed"] == ["emergency_spring stays as it is once the simulation has begun"]
    assert got["deep"][0].startswith("the left bellows is at -")
    assert max(got["goes on"]) < 1e-6, "a refused step leaves no trace"
    assert got["time"] == ["a step begins at 0.5 s, but the last one ended at 0.001 s"]
    assert got["backwards"][0].endswith("a finite length of 0 or more would be right")
    assert got["order"] == ["dpv_reclosing = 500000 exceeds dpv_opening = 120000 (SI)"]
    assert 0.0 < got["empty"] < 1.2e5, "a leak lets out half of it, and it goes on"
    assert got["vacuum"][0].startswith("the left bellows is at 0."), "stretched without air"
    assert got["state"][0].startswith("these 8 bytes are no state of this FMU")


#: What `drive.c` moves, and by how much; what is not taken; what no step is taken with.
DRIVEN = {
    "spring": (("springs.lateral", -2e-4), ("left.height", 1.0), ("left.height", -0.3)),
    "bench": (("lateral.force_setpoint", 50.0), ("platform.roll_setpoint", 1.0), ("dpv_reclosing", 5e5)),
    "car": (("car.wind", 500.0), ("mass", 0.0), ("bump_stop_travel[2]", 0.01)),
}


@pytest.mark.parametrize("name", DRIVEN)
def test_memory_is_its_own(spring_fmus, bench_fmus, car_fmus, tmp_path, name):
    if shutil.which("valgrind") is None:
        pytest.skip("no valgrind here")
    fmu = {"spring": spring_fmus, "bench": bench_fmus, "car": car_fmus}[name][2]
    with zipfile.ZipFile(fmu) as archive:
        (library,) = (one for one in archive.namelist() if one.endswith(".so"))
        archive.extract(library, tmp_path)
        description = ElementTree.fromstring(archive.read("modelDescription.xml"))
    names = [one.get("name") for one in description.iter("ScalarVariable")]
    given = [str(len(names))]
    for variable, value in DRIVEN[name]:
        given += [str(names.index(variable)), str(value)]
    program = tmp_path / "drive"
    subprocess.run(["cc", "-g", "-o", program, HERE / "drive.c", "-ldl"], check=True)
    done = subprocess.run(
        [
            *("valgrind", "-q", "--leak-check=full", "--error-exitcode=99"),
            *(program, tmp_path / library, description.get("guid"), *given),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr, done.stderr


def test_code_for_this_processor_gives_the_same_result(spring_fmus, isolated, ridden, tmp_path):
    """``--native``: other instructions, the same springs."""
    native = tmp_path / "native.fmu"
    write_unit(springs(load()), native, fmi=2, native=True)
    motion, _ = ridden
    given = {"names": NAMES, "times": 1e-3 * np.arange(len(motion)), "motion": motion}
    here, portable = (
        np.array(isolated(fmu, "motion", **given)["outputs"]) for fmu in (native, spring_fmus[2])
    )
    assert equal(here, portable, 1e-9)


def test_without_a_compiler_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    to = tmp_path / "spring.fmu"
    done = CliRunner().invoke(fmu_command, ["spring", "--out", str(to)])
    assert done.exit_code == 3
    assert "no C compiler (cc, gcc or clang) was found" in done.output
    assert "apt-get install gcc libc6-dev" in done.output
    assert not to.exists()


def test_without_a_compiler_for_windows_the_rest_is_exported(tmp_path, monkeypatch):
    (tmp_path / "cc").symlink_to(shutil.which("cc") or pytest.skip("no C compiler"))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert [one.ending for one in platforms()] == [".so"]
    monkeypatch.setattr("astb.fmu.export.write_unit", lambda *given, **options: "{token}")
    done = CliRunner().invoke(fmu_command, ["spring", "--out", str(tmp_path / "spring.fmu")])
    assert done.exit_code == 0
    assert "x86_64-windows: missing" in done.output
    assert "apt-get install gcc-mingw-w64-x86-64" in done.output


def test_every_parameter_of_a_law_is_one_of_the_fmu():
    """What the springs' laws read, and nothing else, can be set."""
    import re

    from bench_sim.model.quantities import PLANT_QUANTITIES

    laws = (
        *("air_spring", "bellows", "gas", "inertance", "orifice", "pipe", "rest", "rubber", "runge_kutta"),
        *("spring", "step_start", "surface", "valves"),
    )
    folder = Path(sys.modules[Plant.__module__].__file__).parent
    read = {name for law in laws for name in re.findall(r"par\.(\w+)", (folder / f"{law}.py").read_text())}
    given = {
        re.sub(r"^(left|right)\.|\[.*", "", one.name)
        for one in springs(load()).variables
        if one.kind in (Kind.FIXED, Kind.TUNABLE)
    }
    assert given == read & {one.name for one in PLANT_QUANTITIES}
