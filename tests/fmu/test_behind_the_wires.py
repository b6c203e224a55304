"""An FMU instead of the springs, behind the wires: its motion is measured, and its failures are reported."""

import math
from pathlib import Path

import numpy as np
import pytest

from astb.api import run_plan
from astb.rig_file import RigFileError, read
from astb.session import build_rig
from bench_records.result import CheckVerdict, Outcome
from bench_sim.fmu.description import FmuError
from bench_sim.model.layout import SENSORS, State
from tests.fmu.asked import build
from tests.fmu.strange_spring import MAP, strange_spring
from tests.refusals import refuses

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
HEAD = 'name = "behind"\ntime = "virtual"\n[simulation]\n'


def rig_file(to: Path, fmu: Path | None, rest: str = "") -> Path:
    """Write a rig file whose springs are an FMU's."""
    to.write_text(HEAD + (f'spring = "{fmu}"\n' if fmu else "") + rest)
    return to


def checks(path: Path, plan: str, out: Path) -> dict:
    result, _ = run_plan(plan, path, out=out)
    return {one.name: one for one in result.checks} | {"verdict": result.verdict}


@pytest.fixture(scope="module")
def strange(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return strange_spring(tmp_path_factory.mktemp("strange") / "strange.fmu")


@pytest.mark.parametrize(
    ("version", "plan", "step", "part"),
    [
        (2, "aw0", "", 0.2),
        (3, "aw0", "5 ms", 0.7),
        (3, "aw3", "", 0.5),
        (3, "lateral_stiffness", "", 0.5),
    ],
)
def test_our_own_export_is_judged_as_the_bench_is(spring_fmus, tmp_path, version, plan, step, part):
    """Verdicts are the same, and values within a ``part`` of the standard uncertainty that they have.

    They are not the same bits: within a tick a spring of the bench feels all four stages of its step, and an FMU none.
    The rest are readings at the edge of a step of their converter. In steps of 5 ms forces are straight
    lines of that length: stiffness at 3 Hz misses 0.08 %.
    """
    own = checks(rig_file(tmp_path / "own.toml", None), plan, tmp_path / "own")
    rest = f'[simulation.spring_map]\nstep = "{step}"\n' if step else ""
    by_fmu = checks(rig_file(tmp_path / "fmu.toml", spring_fmus[version], rest), plan, tmp_path / "fmu")
    assert own["verdict"] is by_fmu["verdict"] is Outcome.PASS
    del own["verdict"], by_fmu["verdict"]
    assert own.keys() == by_fmu.keys()
    for name, one in own.items():
        other = by_fmu[name]
        assert other.verdict is one.verdict is CheckVerdict.PASS
        quantum = 0.01 * abs(one.value) if one.u is None else part * one.u
        if name.startswith(("bolster over platform", "peak of the bolster")) and part > 0.2:
            quantum = 2e-3 * abs(one.value)  # of a peak: two steps of its transducer, 5 µm of 5 mm
        assert abs(other.value - one.value) <= quantum, name


@pytest.mark.parametrize("version", [2, 3])
def test_a_strangers_spring_is_measured_as_it_is(tmp_path, version):
    """Its damping is 6 kN·s/m at every frequency, and its stiffness differs from ours: both are in its source."""
    strange = strange_spring(tmp_path / "strange.fmu", fmi=version)
    found = checks(rig_file(tmp_path / "rig.toml", strange, MAP), "aw0", tmp_path / "out")
    assert found.pop("verdict") is Outcome.FAIL, "aw0 is of our spring"
    for side in ("left", "right"):
        stiffness = [found[f"{side} vertical K' at {f} Hz"].value for f in ("0.5", "1", "2", "3")]
        for f, known in (("0.5", 0.3e3), ("1", 0.15e3), ("2", 0.12e3), ("3", 0.12e3)):
            assert found[f"{side} vertical c at {f} Hz"].value == pytest.approx(6e3, abs=known)
        assert np.ptp(stiffness) < 4e-3 * stiffness[0], "isothermal: as stiff when fast"
        p = found[f"pressure in the {side} bellows"].value + 101_325.0
        bag = p * 0.26**2 / (0.26 * found[f"height of the {side} spring"].value + 0.055) + 3e4
        assert stiffness[1] == pytest.approx(1.0 / (1.0 / bag + 1.0 / 9e6), rel=0.02)
        assert found[f"air lost per minute, {side} spring"].verdict is not CheckVerdict.FAIL


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (1, "failed in doStep of the left spring at 2 s: the FMU returned the status error"),
        (2, "failed while reading outputs of the left spring at 2 s: F = nan is not finite"),
        (3, "crashed (SIGSEGV) in doStep of the left spring at 2 s"),
        (4, "made no progress for 0.3 s in doStep of the left spring at 2 s"),
    ],
)
def test_a_failure_is_a_fault_of_the_rig(tmp_path, bad, said):
    fmu = strange_spring(tmp_path / "bad.fmu", bad)
    rig = build_rig(
        read(
            rig_file(tmp_path / "rig.toml", fmu, MAP.replace("[simulation.spring_map.inputs]", PATIENT, 1))
        ).simulation
    )
    rig.run(1995)
    assert not rig.spring_lost
    assert np.isfinite(rig.values[:SENSORS]).all()
    rig.run(100)
    assert rig.spring_lost == f"bad.fmu {said}"
    assert np.isnan(rig.values[:SENSORS]).all(), "nothing is known any more"
    assert rig.registers.identification()[0x82].decode() == rig.spring_lost
    state = rig.plant.state.copy()
    rig.run(500)
    assert (rig.plant.state == state).all(), "and nothing moves"
    result, _ = run_plan("leveling", tmp_path / "rig.toml", out=tmp_path / "out")
    assert result.verdict is Outcome.BLOCKED
    assert "spring lost" in result.reason
    rig.springs.close()


def test_in_the_process_of_the_rig_it_computes_the_same(strange, tmp_path):
    values = []
    for process in ("own", "rig"):
        text = f'[simulation.spring_map]\nprocess = "{process}"\n{MAP}'
        rig = build_rig(read(rig_file(tmp_path / "rig.toml", strange, text)).simulation)
        rig.run(500)
        values.append(rig.values.tobytes())
        rig.springs.close()
    assert values[0] == values[1]


PATIENT = '[simulation.spring_map]\npatience = "0.3 s"\n[simulation.spring_map.inputs]'

REFUSED = {
    "no map": ("", "has no variables left.height, right.height, left.vertical_force"),
    "a variable that is not there": (
        MAP.replace('"travel"', '"travels"'),
        "spring_map.inputs.height: strange.fmu has no variable travels; did you mean 'travel'?",
    ),
    "a quantity that is not there": (
        MAP.replace("height = ", "hight = "),
        "spring_map.inputs.hight: the bench has no such quantity; did you mean 'height'?",
    ),
    "a unit that cannot be": (
        MAP.replace('"travel"', '"p_bag"').replace('bellows_pressure = "p_bag"', 'bellows_pressure = "F"'),
        "spring_map.inputs.height: p_bag is output in the FMU; use an input",
    ),
    "a force for a pressure": (
        MAP.replace('bellows_pressure = "p_bag"', 'bellows_pressure = "F"'),
        'spring_map.outputs.bellows_pressure: F has the unit "kN" in the FMU',
    ),
    "another unit than the FMU's": (
        MAP.replace('"travel"', '{ variable = "travel", unit = "m" }'),
        'unit = "m" contradicts the FMU, in which travel has the unit "mm"',
    ),
    "no air": (MAP.replace('air_flow = "air"', ""), "has no air flow"),
    "no force": (MAP.replace('vertical_force = "F"', ""), "lacks outputs.vertical_force"),
    "names of both kinds": (
        MAP.replace("height = ", '"left.height" = '),
        "spring_map mixes names of one spring",
    ),
    "half a tick": (
        MAP.replace("[simulation.spring_map.inputs]", '[simulation.spring_map]\nstep = "1.5 ms"\n\\g<0>', 1),
        "not a whole number of ticks",
    ),
    "an effect of our own springs": (
        'effects = { "leak.left" = "0.2 mm2" }' + MAP,
        "leak_conductance of the springs of the model",
    ),
    "a key that is none": (MAP + '[simulation.spring_map.output]\nx = "F"', "spring_map"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_map_that_does_not_fit_is_refused(strange, tmp_path, what):
    rest, said = REFUSED[what]
    rest = rest.replace("\\g<0>", "[simulation.spring_map.inputs]")
    path = rig_file(tmp_path / "rig.toml", strange, rest)
    with pytest.raises((FmuError, RigFileError)) as refused:
        build_rig(read(path).simulation)
    assert said in str(refused.value)


def test_one_for_another_system_is_refused(strange, tmp_path):
    import zipfile

    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(strange) as here, zipfile.ZipFile(other, "w") as there:
        for name in here.namelist():
            there.writestr(name.replace("linux64", "win64"), here.read(name))
    with refuses(FmuError, "win64"):
        build_rig(read(rig_file(tmp_path / "rig.toml", other, MAP)).simulation)


def test_an_immediate_crash_is_reported_before_the_rig_starts(tmp_path):
    fmu = strange_spring(tmp_path / "bad.fmu", 3, area="m2")
    path = rig_file(tmp_path / "rig.toml", fmu, MAP.replace('"travel"', '"travel"'))
    text = path.read_text().replace("[simulation.spring_map.inputs]", SLOW, 1)
    path.write_text(text)
    with refuses(FmuError, "bad.fmu (SIGSEGV) doStep"):
        build_rig(read(path).simulation)


SLOW = '[simulation.spring_map]\nstep = "10 ms"\n[simulation.spring_map.inputs]'


def test_a_slow_fmu_is_reported_before_the_run(tmp_path):
    fmu = strange_spring(tmp_path / "slow.fmu", 5)
    path = rig_file(tmp_path / "rig.toml", fmu, MAP)
    rig = build_rig(read(path).simulation)
    assert rig.springs.too_slow
    text = " ".join(rig.springs.notes)
    assert "1 kHz is not kept in every tick" in text
    assert 'use step = "' in text
    budget = rig.springs.budget
    assert 5e-3 < budget.median < 1.0, "two instances that each sleep for 2.5 ms"
    assert math.isclose(budget.step, 1e-3)
    rig.springs.close()


PYTHONS = """
[simulation.spring_map.inputs]
height = "z"
height_speed = "v"
air_flow = "air"
[simulation.spring_map.outputs]
vertical_force = "F"
bellows_pressure = "p"
"""


#: Units for an FMU that has none.
UNITS = {"z": "m", "v": "m/s", "air": "kg/s", "F": "N", "p": "Pa"}


@pytest.mark.parametrize(("name", "version"), [("PlainSpring", 3), ("OlderSpring", 2)])
def test_python_inside_of_an_fmu_runs_in_a_process_of_its_own(tmp_path, name, version):
    """It uses the interpreter of its own process; the rig's tick does not wait for it."""
    fmu = build(HERE / "models" / f"{name}.py", tmp_path, version)
    text = PYTHONS
    if version == 2:
        for variable, unit in UNITS.items():
            text = text.replace(f'= "{variable}"', f'= {{ variable = "{variable}", unit = "{unit}" }}')
    path = rig_file(tmp_path / "rig.toml", fmu, text)
    rig = build_rig(read(path).simulation)
    said = rig.springs.notes
    assert f"{name}.fmu has no output lateral_force: 0 N is assumed" in said
    assert any(f"{name}.fmu: a step of 1 ms takes" in line for line in said)
    rig.run(3000)
    weight = 0.5 * rig.plant.parameters.bolster_mass * rig.plant.parameters.gravity
    z = rig.plant.state[State.BOLSTER_VERTICAL]
    assert 8e6 * (-0.045 - z) - 3e4 * z == pytest.approx(weight, rel=1e-3), "it rests on its stop, vented"
    assert rig.springs.pressures() == pytest.approx(0.0, abs=20.0)
    rig.springs.close()
