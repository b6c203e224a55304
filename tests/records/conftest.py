"""A synthetic run that looks like the real ones, for tests of records and reports."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench_records.curves import Axis, curve
from bench_records.layout import Phase, SignalInfo
from bench_records.recorder import Recorder
from bench_records.result import Result, Timing, check, conclude

BAR, MM, KN, KELVIN = 1e5, 1e-3, 1e3, 1.0
STATES = {
    0: "OFF",
    1: "INIT",
    2: "DISABLED",
    3: "AIR LOW",
    4: "AIR HIGH",
    5: "HOLD",
    6: "ACTIVE",
    9: "FAULT HOLD",
}
INSTRUCTION = """AW0: the empty car, 53.5 kN on each spring.

The air is raised, the springs level themselves to their design height and carry the preload of the
empty car; then the bench measures what the springs oppose to motion:

* the pressure that carries the preload;
* vertical and lateral stiffness and damping, first harmonic, 5 mm, 0.5 to 3 Hz;
* the answer to a unilateral cosine of 5 mm and to rolling by unequal preload.

The air is let off at the end, whatever happened before.
"""
PHASES = [
    (
        "setup",
        0.0,
        31.0,
        [("raise the air", 0.0, 8.0), ("level to the preload", 8.0, 24.0), ("settle", 24.0, 31.0)],
    ),
    (
        "main",
        31.0,
        92.0,
        [
            ("static pressure", 31.0, 35.0),
            ("vertical sine 0.5 Hz", 35.0, 45.0),
            ("vertical sine 1.0 Hz", 45.0, 52.0),
            ("vertical sine 1.5 Hz", 52.0, 58.0),
            ("vertical sine 2.0 Hz", 58.0, 63.0),
            ("vertical sine 3.0 Hz", 63.0, 67.0),
            ("lateral sine 1.0 Hz", 67.0, 75.0),
            ("unilateral cosine", 75.0, 83.0),
            ("rolling", 83.0, 92.0),
        ],
    ),
    ("teardown", 92.0, 100.0, [("depressurise", 92.0, 100.0)]),
]
SINES = {0.5: (35.0, 45.0), 1.0: (45.0, 52.0), 1.5: (52.0, 58.0), 2.0: (58.0, 63.0), 3.0: (63.0, 67.0)}
SIGNALS = [
    SignalInfo("rig.state", label="state", names=STATES),
    *(SignalInfo(f"{side}.height", "mm", MM, side, "Heights") for side in ("left", "right")),
    *(
        SignalInfo(f"{side}.{part}_pressure", "bar", BAR, f"{side} {part}", "Pressures (gauge)")
        for side in ("left", "right")
        for part in ("bellows", "auxiliary")
    ),
    SignalInfo("supply.pressure", "bar", BAR, "supply", "Supply (gauge)"),
    *(
        SignalInfo(f"actuator.{name}.force", "kN", KN, name.replace("_", " "), "Actuator forces")
        for name in ("vertical_left", "vertical_right", "lateral")
    ),
    *(SignalInfo(f"load_cell.{i}", "kN", KN, f"load cell {i}", "Load cells") for i in range(1, 7)),
    *(
        SignalInfo(f"{side}.{part}_temperature", "K", KELVIN, f"{side} {part}", "Gas temperatures")
        for side in ("left", "right")
        for part in ("bellows", "auxiliary")
    ),
    SignalInfo("rig.sample_counter"),
]
META = {
    "plan": "aw0",
    "rig": "virtual",
    "seed": 7,
    "map_hash": "5f0c2f6a9e7b41d3",
    "versions": {"astb": "0.1.0", "python": "3.11.9", "numpy": "2.4.0", "pyarrow": "26.0.1"},
    "parameters": {"set": "astb", "digest": "9b1f20d7c4f1e8a2"},
}


def motions(t: np.ndarray, rng: np.random.Generator, cut_at: float | None = None) -> dict[str, np.ndarray]:
    """Every signal over time, shaped like the real ones."""
    air = np.clip((t - 1) / 20, 0, 1) * np.clip((98 - t) / 6, 0, 1)
    level = 1 - np.exp(-np.clip(t - 8, 0, None) / 3)
    shake = sum(
        5 * MM * np.sin(2 * np.pi * f * (t - a)) * ((t >= a) & (t < b)) for f, (a, b) in SINES.items()
    )
    cosine = 2.5 * MM * (1 - np.cos(2 * np.pi * 1.0 * (t - 75))) * ((t >= 75) & (t < 83))
    lateral = np.sin(2 * np.pi * (t - 67)) * ((t >= 67) & (t < 75))
    roll = np.sin(2 * np.pi * 0.3 * (t - 83)) * ((t >= 83) & (t < 92))
    rest = -42 * MM * (1 - level * (t < 92) - 0 * air)
    state = np.select([t < 1, t < 2, t < 4, t < 8, t < 31, t < 92], [1, 2, 3, 4, 5, 6], 5).astype(float)
    signals: dict[str, np.ndarray] = {"rig.state": state}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        move = shake + cosine + sign * 6 * MM * roll
        signals[f"{side}.height"] = rest + move + rng.normal(0, 0.05 * MM, t.size)
        p = 2.06 * BAR * air * (1 - 18 * move)
        signals[f"{side}.bellows_pressure"] = p + rng.normal(0, 0.003 * BAR, t.size)
        signals[f"{side}.auxiliary_pressure"] = 2.06 * BAR * air * (1 - 9 * move) + rng.normal(
            0, 0.003 * BAR, t.size
        )
        signals[f"actuator.vertical_{side}.force"] = (
            53.5 * KN * level * (t < 92) + 420 * KN * move * 1.2 + rng.normal(0, 60, t.size)
        )
        for part, gain in (("bellows", 900.0), ("auxiliary", 250.0)):
            signals[f"{side}.{part}_temperature"] = 293.15 + 8 * air * np.exp(-t / 40) + gain * -move
    signals["supply.pressure"] = 9.0 * BAR + 0.4 * BAR * np.sin(t / 9) + rng.normal(0, 0.01 * BAR, t.size)
    signals["actuator.lateral.force"] = 1.2 * KN * lateral + rng.normal(0, 20, t.size)
    for i in range(1, 7):
        signals[f"load_cell.{i}"] = (
            17.8 * KN * level + 400 * (i - 3) + 140 * KN * (shake + cosine) + rng.normal(0, 40, t.size)
        )
    signals["rig.sample_counter"] = np.arange(t.size, dtype=float) % 256
    if cut_at is not None:
        signals["rig.state"] = np.where(t >= cut_at, 9.0, signals["rig.state"])
    return signals


def loops() -> list:
    x, y = Axis("displacement", "mm", MM), Axis("force", "kN", KN)
    angle = np.linspace(0, 2 * np.pi, 400)
    stiffness = {0.5: 341 + 68j, 1.0: 420 + 211j, 1.5: 540 + 315j, 2.0: 692 + 333j, 3.0: 830 + 290j}
    curves = [
        curve(
            f"{f:g} Hz",
            x,
            y,
            5 * MM * np.cos(angle),
            53.5 * KN + np.real(k * 1e3 * 5 * MM * np.exp(1j * angle)) + 250 * np.cos(3 * angle),
            group="Vertical force over displacement",
        )
        for f, k in stiffness.items()
    ]
    f = Axis("frequency", "Hz")
    curves.append(
        curve(
            "lateral 1 Hz",
            x,
            y,
            20 * MM * np.cos(angle),
            2.4 * KN * np.cos(angle) - 500 * np.sin(angle),
            group="Lateral force over displacement",
        )
    )
    for name, unit, scale, number in (
        ("stiffness", "kN/m", 1e3, lambda k, _: k.real * 1e3),
        ("damping", "kN·s/m", 1e3, lambda k, f: k.imag * 1e3 / (2 * np.pi * f)),
    ):
        for side, factor in (("left", 1.0), ("right", 1.03)):
            curves.append(
                curve(
                    side,
                    f,
                    Axis(name, unit, scale),
                    list(stiffness),
                    [factor * number(k, f) for f, k in stiffness.items()],
                    kind="sweep",
                    group=f"Vertical {name}",
                    expanded=[0.02 * factor * abs(number(k, f)) for f, k in stiffness.items()],
                )
            )
    return curves


def checks(failing: bool = False) -> list:
    sine = "vertical sine 1.0 Hz"
    return [
        check(
            "left bellows pressure",
            2.058 * BAR,
            "bar",
            BAR,
            low=2.01 * BAR,
            high=2.11 * BAR,
            phase="static pressure",
            note="53.5 kN on 0.26 m²",
        ),
        check(
            "right bellows pressure",
            (2.24 if failing else 2.0124) * BAR,
            "bar",
            BAR,
            low=2.01 * BAR,
            high=2.11 * BAR,
            phase="static pressure",
        ),
        check("left height", -0.4 * MM, "mm", MM, low=-5 * MM, high=5 * MM, phase="settle"),
        check("right height", 3.1 * MM, "mm", MM, low=-5 * MM, high=5 * MM, phase="settle"),
        check("vertical stiffness", 420e3, "kN/m", 1e3, low=380e3, high=460e3, phase=sine),
        check("vertical damping", 33.6e3, "kN·s/m", 1e3, low=25e3, phase=sine),
        check("lateral stiffness", 122e3, "kN/m", 1e3, low=95e3, high=135e3, phase="lateral sine 1.0 Hz"),
        check("pressure loss in settling", 3.2e3, "kPa", 1e3, high=10e3, phase="settle"),
        check(
            "overshoot of the unilateral cosine",
            0.31 * MM,
            "mm",
            MM,
            high=0.5 * MM,
            phase="unilateral cosine",
        ),
        *(
            [
                check(
                    "lateral acceleration",
                    float("nan"),
                    "m/s²",
                    low=-2.0,
                    high=2.0,
                    phase="rolling",
                    note="the accelerometer was silent",
                )
            ]
            if failing
            else []
        ),
        check("samples lost", 0, high=0),
    ]


def write_run(directory: Path, failing: bool = False, seconds: float = 100.0) -> Result:
    """Record and result of one run, as a plan would leave them."""
    rng = np.random.default_rng(7)
    rate = 200.0
    t = np.arange(0, seconds, 1 / rate)
    start = 5_000_000_000
    values = motions(t, rng, 86.0 if failing else None)
    index = np.arange(len(SIGNALS), dtype=np.int16)
    table = np.column_stack([values[signal.name] for signal in SIGNALS])
    times = start + np.round(t * 1e9).astype(np.int64)
    recorder = Recorder(directory, SIGNALS, META, start_ns=start)
    at = lambda seconds: start + round(seconds * 1e9)  # noqa: E731
    for part, begin, end, inner in PHASES:
        recorder.event(at(begin), "phase", part, edge="begin")
        for name, first, last in inner:
            recorder.event(at(first), "phase", name, edge="begin")
            recorder.event(at(last), "phase", name, edge="end")
        recorder.event(at(end), "phase", part, edge="end")
    recorder.event(at(2.0), "state", "INIT \u2192 DISABLED")
    recorder.event(at(8.0), "state", "AIR HIGH \u2192 HOLD", by="plan")
    recorder.event(at(31.0), "state", "HOLD \u2192 ACTIVE", by="plan")
    for one in checks(failing):
        recorder.event(at(90.0), "check", str(one))
    if failing:
        recorder.event(
            at(86.0),
            "trip",
            "right bellows pressure above 2.2 bar",
            signal="right.bellows_pressure",
            limit=2.2e5,
        )
        recorder.event(at(86.012), "state", "ACTIVE \u2192 FAULT HOLD")
        recorder.event(at(86.3), "trip", "left height error above 8 mm", signal="left.height")
    for first in range(0, t.size, 50):
        part = slice(first, first + 50)
        rows = times[part].size
        recorder.receive(np.repeat(times[part], index.size), np.tile(index, rows), table[part].ravel())
    recorder.close(lateness={"late": 0, "max_us": 412.0})
    edges = [10e-6, 20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1e-3]
    result = conclude(
        "aw0",
        "Empty car (AW0): 53.5 kN on each spring",
        INSTRUCTION,
        checks(failing),
        curves=loops(),
        phases=[
            phase
            for part, a, b, inner in PHASES
            for phase in (Phase(part, a, b), *(Phase(name, c, d, 1) for name, c, d in inner))
        ],
        rig="virtual",
        seed=7,
        timing=Timing(
            ticks=100_000,
            late=0,
            period=1e-3,
            p50=62e-6,
            p99=138e-6,
            max=412e-6,
            edges=edges,
            counts=[312, 4_021, 31_877, 58_410, 5_236, 144, 0, 0],
        ),
    )
    result.write(directory)
    return result


@pytest.fixture(scope="session")
def run_writer() -> Callable[..., Result]:
    """The function that writes a synthetic run into a directory."""
    return write_run


@pytest.fixture(scope="session")
def passed_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 100 s that passed; not to be written to."""
    directory = tmp_path_factory.mktemp("passed")
    write_run(directory)
    return directory


@pytest.fixture(scope="session")
def failed_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 100 s that tripped and failed; not to be written to."""
    directory = tmp_path_factory.mktemp("failed")
    write_run(directory, failing=True)
    return directory
