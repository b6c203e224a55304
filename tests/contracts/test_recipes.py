"""The recipes of CONTRIBUTING.md, done on a copy of the tree: they work, and only the files that they name change."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bench_protocol.registers import free_address
from bench_protocol.table import TABLE

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
#: What `make generate` may write after a recipe.
OF_THE_TABLE = {
    *(
        f"bench_protocol/generated/{name}"
        for name in ("astb.dbc", "astb.eds", "kept_map.csv", "modbus_map.csv")
    ),
    *(f"docs/reference/{name}.md" for name in ("signals", "canopen")),
    "astb/data/rigs/local/instruments.toml",
}
OF_THE_EFFECTS = {
    *(f"docs/reference/{name}.md" for name in ("effects", "parameters")),
    "docs/tutorials/find-a-hidden-effect.md",
}


class Copy:
    """A copy of the tracked and the compiled files, in which a recipe is done."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        listed = subprocess.run(
            ["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True
        )
        names = [
            name
            for name in listed.stdout.decode().split("\0")
            if name and not name.startswith(("tests/", "studies/tests/"))
        ]
        for name in names:
            place = folder / name
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place)
        self.before = self._contents()

    def with_compiled(self) -> "Copy":
        """Copy the compiled files, for a recipe that leaves the compiled code as it is."""
        for source in {name.parent for name in self.before}:
            for one in (ROOT / source / "__pycache__").glob("*.nb[ic]"):
                place = self.folder / source / "__pycache__" / one.name
                place.parent.mkdir(exist_ok=True)
                shutil.copy2(one, place)
        return self

    def _contents(self) -> dict[Path, bytes]:
        kinds = (".py", ".md", ".toml", ".csv", ".dbc", ".eds")
        found = (path for path in self.folder.rglob("*") if path.suffix in kinds and "runs" not in path.parts)
        return {path.relative_to(self.folder): path.read_bytes() for path in found}

    def behind(self, name: str, line: str, new: str) -> None:
        """Put ``new`` behind a ``line`` of a file."""
        path = self.folder / name
        text = path.read_text(encoding="utf-8")
        assert text.count(f"{line}\n") == 1, f"{name} has no one line {line!r}"
        path.write_text(text.replace(f"{line}\n", f"{line}\n{new}\n"), encoding="utf-8")

    def run(self, *command: str, plain: bool = True) -> str:
        """Run Python in the copy, as plain Python unless it is compiled there already; return what it says."""
        environment = os.environ | {
            "PYTHONPATH": f"{self.folder}:{self.folder / 'studies'}",
            "NUMBA_DISABLE_JIT": str(int(plain)),
        }
        done = subprocess.run(
            [sys.executable, *command],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
        return done.stdout

    @property
    def changed(self) -> set[str]:
        after = self._contents()
        return {str(path) for path in {*self.before, *after} if self.before.get(path) != after.get(path)}


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path / "astb")


def named(section: str) -> set[str]:
    """Return the files and folders that a section of the page names."""
    text = PAGE.split(f"\n## {section}\n")[1].split("\n## ")[0]
    return set(re.findall(r"`((?:bench|drivers|test_plans|diagnosis)[\w/.]*)`", text))


SPEED = """    PLATFORM_SPEED = SensorRow(
        "platform_speed",
        panel="Speed of the platform",
        unit="m/s",
        carried=(-2.0, 2.0),
        step=0.001,
        at_rest=(-0.05, 0.05),
        instrument="speed_transducer",
        type="moving coil in a magnet, ± 1 m/s",
        reads=(-1.0, 1.0),
        accuracy=0.002,
        gain=0.005,
        lag=0.001,
        resolution=0.0005,
        noise=0.001,
        bias_max=0.5,
        source="data sheet of the example",
        noise_source="data sheet of the example",
    )"""

LOOK = '''
import sys
from pathlib import Path
from astb.rig_in_memory import RigInMemory
from bench_protocol.table import TABLE
from bench_records.record import read
from bench_records.report import write_report
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.execution import execute
from test_plans.instruments import ordinary
from test_plans.plan import plan
from test_plans.run import NullWatcher

@plan(setup=lambda run: None, teardown=lambda run: None)
def look(run):
    """Look: what is there."""
    run.bench.wait(0.6)
    on_can = run.bench.platform.speed
    on_modbus = run.bench.wiring.read(["platform.speed", "left.height"])["platform.speed"]
    run.check("on both wires", on_can - on_modbus, "m/s", low=-0.1, high=0.1)
    mean = run.bench.averages("platform.speed", over=0.3)
    speed = run.measured(lambda means: means["platform.speed"], mean, over=0.3)
    run.check("at rest", speed, "m/s", low=-0.1, high=0.1)

memory = RigInMemory(Rig(load(), seed=1))
bench = memory.bench()
bench.instruments = ordinary()
with bench:
    result = execute(look, bench, Path(sys.argv[1]), watcher=NullWatcher())
    assert result.verdict == "pass", result
    shown = "speed" in repr(bench.platform)
assert "platform.speed" in bench.instruments.pieces
(uncertain,) = (one.u for one in result.checks if one.name == "at rest")
assert 0.5e-3 < uncertain < 5e-3, uncertain
write_report(Path(sys.argv[1]))
report = (Path(sys.argv[1]) / "report.html").read_text()
assert all(text in report for text in ("Speed of the platform", "platform.speed"))
times, values = read(Path(sys.argv[1])).series("platform.speed")
assert len(times) >= 5 and max(abs(values)) < 0.2, values
print(f"{TABLE.map_hash:08x}", shown)
'''


@pytest.mark.slow
def test_a_reading(copy: Copy, tmp_path: Path) -> None:
    """A sensor of a new group: check-rig, report and uncertainty have it."""
    address = free_address(TABLE.signals)
    by_hand = {
        "bench_protocol/table_groups.py": (
            '        noise_source="from two transducers",\n    )',
            SPEED,
        ),
        "bench_protocol/table_signals.py": (
            '    _reading("platform.roll", 152, Group.PLATFORM_ROLL, "Vibration platform, left side up"),',
            f'    _reading("platform.speed", {address}, Group.PLATFORM_SPEED, "Speed of the platform, up"),',
        ),
        "bench_protocol/table_messages.py": (
            '        "What the bench is doing and why",\n    ),',
            '    _message("Speeds", 0x283, SLOW_RATE, _fields("platform.speed"), "More of them"),',
        ),
        "bench_sim/model/layout.py": ("    PLATFORM_ROLL = 26", "    PLATFORM_SPEED = 27"),
        "bench_sim/model/sensors.py": (
            "    values[Sensor.PLATFORM_ROLL] = x[State.PLATFORM_ROLL]",
            "    values[Sensor.PLATFORM_SPEED] = x[State.PLATFORM_VERTICAL_SPEED]",
        ),
        "drivers/axes.py": ("    roll = Reading()  #: rad", "    speed = Reading()  #: m/s"),
    }
    for name, (line, new) in by_hand.items():
        copy.behind(name, line, new)
    assert set(by_hand) <= named("A device")
    assert "A reading is written in five files" in PAGE and len(by_hand) == 6  # and its new group in one more
    copy.run("-m", "tools.generate")
    assert copy.changed == {*by_hand, *OF_THE_TABLE, "docs/reference/parameters.md"}
    copy.run("-m", "tools.generate", "--check")
    map_hash, shown = copy.run("-c", LOOK, str(tmp_path / "runs")).split()
    assert map_hash != f"{TABLE.map_hash:08x}"
    assert shown == "True"
    checked = json.loads(copy.run("-m", "astb", "rig", "check", "virtual", "--json"))
    (line,) = (one for one in checked["signals"] if one["name"] == "platform.speed")
    assert line["verdict"] == "fine", line


HARDENING = """    # The shell of the bellows stiffens the further it is deflected: F += k ζ (ζ/10 mm)².
    Effect(
        name="hardening",
        family="gas",
        title="a shell that stiffens as it is deflected",
        plain="the shell stiffens as it is deflected",
        amplitude=EffectParameter("stiffness", "N/m", "kN/m", 1e3, nominal=0.0, typical=1e3, low=0.0, high=1e5),
        change=adds("shell_hardening", "stiffness"),
        touches=frozenset({"force"}),
        confusers=("area_slope",),
        equation="F_z += k ζ (ζ/10 mm)²",
        source="a cubic spring",
        separated_by="vertical sines of two amplitudes",
    ),"""

PRESSED = """
import numpy as np
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.lanes.start import has_lanes
from bench_sim.model.plant import Plant
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects
from diagnosis.systems.air_spring.simulator import AirSpring

sound = load("astb")
def hard(size):
    return with_effects(sound, {"hardening": {"stiffness": size}})
def readings(parameters):
    plant = Plant.depressurised(parameters.record)
    plant.step(20)
    return plant.ideal()
absent, small, large = (readings(hard(size)) for size in (0.0, 1e3, 2e3))
assert np.array_equal(absent, readings(sound))
assert 0.0 < np.abs(small - absent).max() < np.abs(large - absent).max()
assert has_lanes(sound.record) and not has_lanes(hard(1.0).record)
assert "hardening" in AirSpring(sound, effects=CATALOGUE).catalogue
"""


@pytest.mark.slow
def test_an_effect(copy: Copy) -> None:
    """A term, a row of parameters and a row of effects: nothing else is touched."""
    copy.behind(
        "bench_sim/model/spring.py",
        "    branch_y, stiff_y = maxwell_pull(x, par, State.LATERAL_DASHPOT + side * BRANCHES, k_y, y)",
        "    if par.shell_hardening[side] != 0.0:\n"
        "        harder = par.shell_hardening[side] * (zeta / 0.01) ** 2\n"
        "        branch_z += harder * zeta\n"
        "        stiff_z += 3.0 * harder",
    )
    copy.behind(
        "bench_sim/model/quantities.py",
        "    # gas and flow beyond the above",
        '    *_off("N/m", "shell_hardening", low=0.0, high=1e6, shape=_SIDE),',
    )
    copy.behind("bench_sim/model/effects/gas.py", "EFFECTS: Final = (", HARDENING)
    by_hand = {f"bench_sim/model/{name}.py" for name in ("spring", "quantities", "effects/gas")}
    assert copy.changed == by_hand
    copy.run("-c", PRESSED)
    copy.run("-m", "tools.generate")
    assert copy.changed == by_hand | OF_THE_EFFECTS
    copy.run("-m", "tools.generate", "--check")


@pytest.mark.slow
def test_a_plan(copy: Copy) -> None:
    """The plan of the page: one file, found by its name, with the predicted contents of its report."""
    code = re.search(r"`test_plans/plans/symmetry\.py`:\n\n```python\n(.*?)```", PAGE, re.DOTALL)
    assert code is not None
    (copy.folder / "test_plans/plans/symmetry.py").write_text(code[1], encoding="utf-8")
    assert "symmetry" in copy.run("-m", "astb", "plans")
    assert "pressure, left less right" in copy.run("-m", "astb", "plans", "symmetry")
    said = copy.with_compiled().run(
        "-m", "astb", "run", "symmetry", "--virtual", "--out", str(copy.folder / "runs"), plain=False
    )
    assert "pass" in said
    copy.run("-m", "tools.generate", "--check")
    assert copy.changed == {"test_plans/plans/symmetry.py"}


SUPPLY_VALVE = """def _supply_valve(points: InsertionPoints, v: Values) -> Undo:
    return points.tick.hold({Input.SUPPLY: 1.0 if v["at"] == "open" else 0.0})

"""
SUPPLY_VALVE_ROW = """    Fault(
        "stuck_supply_valve",
        FaultPlace.PLANT,
        "The main valve of the supply is stuck.",
        "Shut: `supply.pressure` is that of the atmosphere, and nothing can be filled. Open: nothing vents it.",
        _supply_valve,
        (FaultChoice("at", ("open", "shut"), "where it is stuck"),),
    ),"""
STUCK = """
from astb.rig_in_memory import RigInMemory
from bench_protocol.units import bar
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig

memory = RigInMemory(Rig(load(), seed=1))
with memory.bench() as bench:
    bench.wait(0.1)
    shut = bench.supply.pressure
    memory.rig.faults.on("stuck_supply_valve", {"at": "open"})
    bench.wait(1.0)
    stuck = bench.supply.pressure
    memory.rig.faults.off("all")
    bench.wait(1.0)
    assert shut < 0.2 * bar and stuck > 7 * bar and bench.supply.pressure < 0.2 * bar, (shut, stuck)
"""
OPENED = """
from pathlib import Path
from drivers.errors import WiringError
from drivers.wiring.transports import open_transport

keys = {"kind": "lines_of_text", "host": "127.0.0.1", "port": 7000, "points": ["height"]}
made = open_transport("press", keys, Path())
made.require("height")
assert type(made).__name__ == "Controller", made
try:
    open_transport("press", keys | {"kind": "lines_of_txt"}, Path())
except WiringError as error:
    assert "lines_of_text" in str(error), error
else:
    raise AssertionError("an unknown kind was opened")
"""


@pytest.mark.slow
def test_a_fault(copy: Copy) -> None:
    """A function that breaks something and returns what repairs it, and a row: one file."""
    name = "bench_sim/rig/faults/plant.py"
    copy.behind(
        name,
        '    return points.parameters.change(("supply_sawtooth", "supply_pressure"), change)\n',
        SUPPLY_VALVE,
    )
    copy.behind(name, "FAULTS: Final = (", SUPPLY_VALVE_ROW)
    copy.run("-m", "tools.generate")
    assert copy.changed == {name, "docs/reference/faults.md"}
    assert name in named("A fault")
    copy.with_compiled().run("-c", STUCK, plain=False)


def test_a_transport(copy: Copy) -> None:
    """The example of a transport moves into the tree: a separate package and one row."""
    code = (ROOT / "tests/foreign/lines.py").read_text(encoding="utf-8")
    folder = copy.folder / "drivers/wiring/lines_of_text"
    folder.mkdir()
    (folder / "__init__.py").write_text('"""The transport on lines of text."""\n', encoding="utf-8")
    (folder / "transport.py").write_text(code, encoding="utf-8")
    name = "drivers/wiring/transports.py"
    path = copy.folder / name
    before = path.read_text(encoding="utf-8")
    row = '"lines_of_text": "drivers.wiring.lines_of_text.transport:controller"'
    path.write_text(
        before.replace("_FACTORIES: Final = {", f"_FACTORIES: Final = {{{row}, "), encoding="utf-8"
    )
    assert copy.changed == {
        name,
        *(f"drivers/wiring/lines_of_text/{one}.py" for one in ("__init__", "transport")),
    }
    assert name in named("A transport")
    copy.run("-c", OPENED)
