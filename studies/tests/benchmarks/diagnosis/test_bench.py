"""Effects that another process hides in the bench and measures are found, or get no wrong name."""

import json
import subprocess
import sys

import numpy as np
import pytest

from astb_studies.benchmarks.diagnosis.ground_truth import draw
from astb_studies.benchmarks.diagnosis.sealed import COLOURED, measure, of_twelve_bits
from astb_studies.places import ROOT
from bench_protocol.rates import FAST_RATE
from bench_protocol.table import TABLE
from bench_records.record import read
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.finding import Verdict
from diagnosis.systems.air_spring.simulator import OUTPUTS

#: A few candidates of every family; the whole catalogue is the benchmark's.
FEW = (
    "maxwell",
    "friction",
    "creep",
    "leak.left",
    "leak.right",
    "heat",
    "asymmetric_orifice",
    "pressure_lag",
    "force_gain",
    "pressure_drift.left",
    "pressure_drift.right",
)
#: A seed that hides a leak on the right.
LEAKING = 23
GASEOUS = ("leak.left", "leak.right", "heat", "pressure_drift.right")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_leak_is_found_on_its_side(judged):
    found = judged("bench", "single", "white", LEAKING, effects=GASEOUS)
    assert found.hidden == ["leak.right"]
    assert not found.amiss
    assert found.reported


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("kind", "condition", "seed"),
    [
        ("null", "white", 1),
        ("single", "AR 0.9", 9),
        ("single", "frames lost", 25),
        ("outside", "white", 2),
    ],
)
def test_an_honest_answer(judged, kind, condition, seed):
    hidden = draw(seed, kind, condition).effects
    assert hidden.keys() <= set(FEW)
    found = judged("bench", kind, condition, seed, effects=FEW)
    # λ is that in white noise. Of the 48 of this friction, noise of another colour leaves 7: too little to name it.
    assert not found.amiss or (condition == "AR 0.9" and found.verdict == Verdict.UNRESOLVED.value)
    assert not found.wrong


@pytest.mark.slow
def test_lost_frames_do_not_keep_a_bench_from_being_screened(tmp_path):
    """Every tenth reading is missing, now and then enough in a row to leave a gap; commands arrive."""
    truth = draw(17, "single", "frames lost")
    measure(truth, tmp_path)
    record = read(tmp_path)
    assert all(
        check["verdict"] == "pass" for check in json.loads((tmp_path / "result.json").read_text())["checks"]
    )
    phase = next(one for one in record.phases if one.name.startswith("replay "))
    fast = [message.fields[0].signal for message in TABLE.messages if message.rate == FAST_RATE]
    received = [times[(times >= phase.start) & (times <= phase.end)] for times, _ in map(record.series, fast)]
    assert max(np.diff(inside).max() for inside in received) > 5.5 / FAST_RATE
    assert all(0.88 < len(inside) / (phase.duration * FAST_RATE) < 0.92 for inside in received)


def test_a_coarse_converter_has_steps_of_the_wire():
    """Twelve bits to the nearest step of the wire: rounded twice to other steps, a load cell would not be straight."""
    bench = load()
    coarse, fine = of_twelve_bits(bench), bench.entries["sensor_resolution"].value
    span = bench.entries["sensor_high"].value - bench.entries["sensor_low"].value
    wire = {message.signal: message.step for one in TABLE.messages for message in one.fields}
    for name, sensor in OUTPUTS.items():
        if sensor not in COLOURED:
            assert coarse[sensor] == fine[sensor]
            continue
        assert coarse[sensor] == pytest.approx(span[sensor] / 4096, rel=0.06)
        step = wire[name] or TABLE[name].step
        assert coarse[sensor] / step == pytest.approx(round(coarse[sensor] / step))


@pytest.mark.slow
def test_a_sealed_record_does_not_reveal_the_effects(tmp_path):
    record, truth = tmp_path / "record", tmp_path / "truth.json"
    command = [
        sys.executable,
        "-m",
        "astb_studies.benchmarks.diagnosis.sealed",
        f"--seed={LEAKING}",
        "--kind=single",
    ]
    subprocess.run([*command, f"--out={record}", f"--truth={truth}"], check=True, cwd=ROOT, timeout=100)
    assert b"leak.right" in truth.read_bytes()
    known = read(record)
    texts = [path.read_text() for path in record.rglob("*") if path.suffix in {".json", ".xml"}]
    texts += [str(known.meta), *(f"{event.text} {event.data}" for event in known.events)]
    assert len(texts) > 20
    wired = " ".join(
        signal.name for signal in TABLE.signals
    )  # a car's signals are named after its bump stop, too
    named = [name for name in CATALOGUE if "_" in name and name not in wired]
    for word in ("effect", "leak", "sealed", "roughness", *named):
        assert not [text for text in texts if word in text], word
