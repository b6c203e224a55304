"""A run for the drawing of the bench: the values at each of its instants."""

import json

import numpy as np
import pandas as pd
import pytest

from bench_protocol.units import NS
from bench_records.layout import SignalInfo
from bench_records.plot_data import GAP, STEPS, PlotData
from bench_records.record import read
from bench_records.recorder import Recorder
from bench_records.replay import APART, PICTURES, STANDS, replay_of, thinned


@pytest.fixture
def record(tmp_path):
    """A run of 20 s: a height at 200 Hz with a gap of 6 s, a temperature each second, a valve that opens, a trip."""
    signals = [
        SignalInfo("left.height", "mm", 1e-3, quantity="Heights"),
        SignalInfo("left.bellows_temperature", "K", 1.0, quantity="Temperatures"),
        SignalInfo("rig.state", names={0: "DISABLED", 1: "FAULT_HOLD"}),
    ]
    facts = {"plan": "aw0", "dimensions": {"known": {"spring_half_spacing": {"value": 0.9}}}}
    with Recorder(tmp_path, signals, facts, start_ns=0) as recorder:
        fast = np.arange(0.0, 20.0, 0.005)
        fast = fast[(fast < 8.0) | (fast > 14.0)]
        for column, times, values in (
            (0, fast, 0.02 * np.sin(fast)),
            (1, np.arange(20.0), 293.15 + np.arange(20.0)),
            (2, np.array([0.0, 12.0]), np.array([0.0, 1.0])),
        ):
            recorder.receive(np.rint(times * NS).astype(np.int64), np.full(times.size, column), values)
        recorder.event(0, "setting", "", **{"air.left_mode": "hold", "rig.pipe": "off"})
        recorder.event(5 * NS, "setting", "", **{"air.left_mode": "fill"})
        recorder.event(12 * NS, "trip", "limit of left.height tripped", signal="left.height")
    return read(tmp_path)


def unpacked(numbers: PlotData, at: list[float]) -> np.ndarray:
    start, count, low, high = at
    words = np.concatenate([np.frombuffer(part, "<u2") for part in numbers._parts])[int(start) :][
        : int(count)
    ]
    return np.where(words == GAP, np.nan, low + words / STEPS * (high - low))


def test_at_each_instant_stands_the_sample_before_it_as_pandas_finds_it(record) -> None:
    numbers = PlotData()
    told = replay_of(record, numbers)
    assert told is not None
    assert (told["step"], told["dimensions"]) == (APART, {"spring_half_spacing": 0.9})
    signals = {one["name"]: one for one in told["signals"]}
    grid = pd.DataFrame({"t": np.arange(200) * APART + 1e-9})
    for name, rounding in (("left.height", 0.06), ("left.bellows_temperature", 0.06)):
        times, values = record.series(name)
        samples = pd.DataFrame({"t": times, "value": record.signals[name].shown(values)})
        expected = pd.merge_asof(grid, samples, on="t", tolerance=STANDS)["value"].to_numpy()
        found = unpacked(numbers, signals[name]["at"])[:200]
        assert np.isnan(expected).any() == (name == "left.height"), "the gap is one"
        np.testing.assert_allclose(found, expected, atol=rounding)
    assert signals["left.bellows_temperature"]["unit"] == "°C"
    assert signals["right.height"]["at"] is None, "what was not recorded has no series"


def test_valves_states_trips_and_events_keep_their_instants(record) -> None:
    told = replay_of(record, PlotData())
    assert told is not None
    assert told["settings"] == [(0.0, {"air.left_mode": "hold"}), (5.0, {"air.left_mode": "fill"})]
    assert told["states"] == [(0.0, "DISABLED"), (12.0, "FAULT HOLD")]
    assert told["trips"] == [(12.0, "left.height")]
    assert (12.0, "limit of left.height tripped") in told["events"]
    assert json.loads(json.dumps(told))["duration"] == pytest.approx(19.995)


def test_a_long_run_has_no_more_pictures_than_an_eye_wants(record) -> None:
    duration = 36_000.0
    times = np.arange(0.0, duration, 0.5)
    record.duration = duration
    step = replay_of(record, PlotData())["step"]
    assert duration / step <= PICTURES < duration / step + 10
    assert thinned(times, times, duration, step, 3).size <= PICTURES + 1


def test_a_record_without_readings_of_the_bench_has_no_replay(tmp_path) -> None:
    with Recorder(tmp_path, [SignalInfo("x", "mm", 1e-3)], {"plan": "own"}, start_ns=0) as recorder:
        recorder.receive([0, NS], [0, 0], [0.0, 1.0])
    assert replay_of(read(tmp_path), PlotData()) is None
