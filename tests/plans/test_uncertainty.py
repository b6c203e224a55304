"""The uncertainty of computed values: closed forms of the GUM, Monte Carlo (JCGM 101), and the simulated sensors."""

from dataclasses import replace
from math import sqrt, tau
from types import SimpleNamespace

import numpy as np
import pytest

from bench_protocol.clock import VirtualClock
from bench_protocol.table import TABLE
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.units import UNITS, bar, kN, mm, ms
from bench_records.conformity import conformity, coverage_factor, cumulative, decimals, guard_factor
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import load
from drivers.wiring.contract import Stamp
from test_plans.analysis import dynamic_stiffness
from test_plans.analysis.uncertainty import (
    COUNTED,
    EVEN,
    Measured,
    counted,
    measured,
    timed,
    yes_or_no,
)
from test_plans.instruments import (
    Instrument,
    Instruments,
    InstrumentsError,
    Piece,
    ordinary,
    read_instruments,
)
from test_plans.run import Run

LASER = Instrument("laser", "laser", offset=0.05 * mm, gain=0.001)
CELL = Instrument("cell", "cell", offset=200.0, gain=0.002)
SIGNALS = {"left.height": LASER, "right.height": LASER, "load_cell.1": CELL, "load_cell.3": CELL}


def instruments(**changed):
    return Instruments("", "", {s: Piece(s, replace(one, **changed), "1") for s, one in SIGNALS.items()})


def test_a_linear_model_has_the_uncertainty_of_the_law_of_propagation():
    means = {"left.height": 100 * mm, "load_cell.1": 30 * kN, "load_cell.3": 25 * kN}
    (found,) = measured(
        lambda m: 3 * m["left.height"] * 1e6 + m["load_cell.1"] - 2 * m["load_cell.3"],
        means,
        instruments=instruments(),
    )
    parts = [
        3e6 * 0.05 * mm, 3e6 * 0.001 * 100 * mm,
        200.0, 0.002 * 30 * kN,
        2 * 200.0, 2 * 0.002 * 25 * kN,
    ]  # fmt: skip
    assert found.value == pytest.approx(3e5 + 30e3 - 50e3)
    assert found.u == pytest.approx(sqrt(sum(p**2 for p in parts) / 3))
    assert found.even == pytest.approx(400.0 / sqrt(3))
    assert found.parts["cell offset"] == pytest.approx(sqrt(200**2 + 400**2) / sqrt(3))


def test_a_ratio_adds_relative_uncertainties_of_two_instruments_and_cancels_one():
    means = {"left.height": 20 * mm, "right.height": 10 * mm}
    gain = instruments(offset=0.0)
    (ratio,) = measured(lambda m: m["left.height"] / m["right.height"], means, instruments=gain)
    assert ratio.u / ratio.value == pytest.approx(0.001 * sqrt(2) * EVEN, rel=1e-5)
    (same,) = measured(
        lambda a, b: a["left.height"] / b["left.height"],
        {"left.height": 20 * mm},
        {"left.height": 10 * mm},
        instruments=gain,
    )
    assert same.u < 1e-9  # the gain of a laser is the same before and after
    (lost,) = measured(
        lambda a, b: a["left.height"] - b["left.height"],
        {"left.height": 20 * mm},
        {"left.height": 10 * mm},
        instruments=instruments(gain=0.0),
    )
    assert lost.u == pytest.approx(0.0, abs=1e-12)  # and so is its offset


def test_noise_is_averaged_and_a_step_only_where_the_noise_lets_it():
    readings = {"left.height": np.full(400, 5 * mm)}
    noisy = instruments(offset=0.0, gain=0.0, noise=0.01 * mm)
    (mean,) = measured(lambda m: m["left.height"].mean(), readings, instruments=noisy)
    assert mean.u == pytest.approx(0.01 * mm / 20, rel=0.3)  # 32 draws
    (told,) = measured(lambda m: m["left.height"], {"left.height": 5 * mm}, instruments=noisy, averaged=400)
    assert told.u == pytest.approx(0.01 * mm / 20, rel=0.3)
    coarse = instruments(offset=0.0, gain=0.0, resolution=0.2 * mm)
    (step,) = measured(lambda m: m["left.height"], {"left.height": 5 * mm}, instruments=coarse, averaged=400)
    assert step.u == pytest.approx(0.2 * mm / sqrt(12), rel=0.3)


def test_a_late_laser_makes_a_damper_of_a_spring():
    frequency, K = 2.0, 460e3
    times = np.arange(400) / 200.0
    motion = 5 * mm * np.sin(tau * frequency * times)
    readings = {"left.height": -motion, "load_cell.1": 0.5 * K * motion, "load_cell.3": 0.5 * K * motion}

    def both(m):
        found = dynamic_stiffness(times, -m["left.height"], m["load_cell.1"] + m["load_cell.3"], frequency)
        return found.storage, found.damping

    late = instruments(offset=0.0, gain=0.0)
    pieces = dict(late.pieces)
    pieces["left.height"] = Piece("left.height", Instrument("laser", "", lag=0.3 * ms), "")
    stiff, damped = measured(both, readings, instruments=Instruments("", "", pieces))
    assert damped.value == pytest.approx(0.0, abs=1.0)
    assert damped.u == pytest.approx(K * 0.3 * ms * EVEN, rel=0.01)  # c = K'' / ω = K δτ
    assert stiff.u < 0.01 * K * tau * frequency * 0.3 * ms


def test_the_law_of_propagation_agrees_with_monte_carlo_through_the_same_evaluation():
    rng = np.random.default_rng(4)
    times = np.arange(200) / 200.0
    motion = 5 * mm * np.sin(tau * 2 * times)
    force = 300e3 * motion + 27 * kN
    nonlinear = instruments(nonlinearity=0.1 * mm)
    pieces = {name: nonlinear.pieces[name] for name in ("left.height", "load_cell.1")}
    pieces["load_cell.1"] = Piece("load_cell.1", CELL, "")

    def stiffness(m):
        return dynamic_stiffness(times, -m["left.height"], m["load_cell.1"], 2.0).storage

    readings = {"left.height": 60 * mm - motion, "load_cell.1": force}
    (found,) = measured(stiffness, readings, instruments=Instruments("", "", pieces))

    def even(half):
        return half * rng.uniform(-1, 1)

    drawn = []
    for _ in range(2000):
        h, f = readings["left.height"], readings["load_cell.1"]
        bow = 1 - (h / (150 * mm)) ** 2
        drawn.append(
            stiffness(
                {
                    "left.height": h * (1 + even(0.001)) + even(0.05 * mm) + even(0.1 * mm) * bow,
                    "load_cell.1": f * (1 + even(0.002)) + even(200.0),
                }
            )
        )
    assert found.u == pytest.approx(np.std(drawn), rel=0.05)
    share = np.mean(np.abs(np.array(drawn) - found.value) < coverage_factor(found.even / found.u) * found.u)
    assert share == pytest.approx(0.9545, abs=0.02)


def test_no_uncertainty_without_an_instrument_with_the_reason():
    (found,) = measured(lambda m: m["left.height"] + m["supply.pressure"], {"left.height": 1.0, "supply.pressure": 2.0},
                        instruments=instruments())  # fmt: skip
    assert (found.value, found.u) == (3.0, None)
    assert found.unknown == "no instrument is known for supply.pressure"


@pytest.mark.parametrize(
    "read",
    [
        lambda m: m["left.height"],
        lambda m: m.get("left.height"),
        lambda m: sum(m.values()),
        lambda m: dict(m)["left.height"],
        lambda m: next(value for _, value in m.items()),
    ],
)
def test_a_reading_counts_whichever_way_it_is_read(read):
    (found,) = measured(read, {"left.height": 1.0}, instruments=instruments(gain=0.0))
    assert found.u == pytest.approx(0.05 * mm * EVEN)


def test_what_is_computed_of_no_reading_is_not_certain():
    readings = {"left.height": 1.0}
    (found,) = measured(lambda m: readings["left.height"], readings, instruments=instruments())
    assert (found.u, found.unknown) == (None, "it was computed of no reading")


def test_a_size_near_zero_is_as_uncertain_as_what_it_is_the_size_of():
    (found,) = measured(lambda m: abs(m["left.height"]), {"left.height": 0.0}, instruments=instruments())
    assert found.u == pytest.approx(0.05 * mm * EVEN)


def test_the_noise_of_a_slow_signal_is_that_of_its_few_samples():
    """Of 400 places on lines between 20 samples, the mean is as uncertain as that of 20, and a little more."""
    values = {"left.height": np.zeros(400)}
    noisy = instruments(offset=0.0, gain=0.0, noise=1e-3)
    fast, slow = (
        measured(lambda m: m["left.height"].mean(), values, instruments=noisy, rate=200.0, came=came)[0].u
        for came in ({"left.height": 200.0}, {"left.height": 10.0})
    )
    assert fast == pytest.approx(1e-3 / sqrt(400), rel=0.3)
    assert slow == pytest.approx(1e-3 / sqrt(20), rel=0.3)


def test_the_uncertainty_of_instruments_is_only_noise():
    means = {"left.height": 0.02 * mm}
    noisy = instruments(noise=0.01 * mm)
    (zero,) = measured(lambda m: m["left.height"], means, instruments=noisy, averaged=100, themselves=True)
    assert zero.u == pytest.approx(0.001 * mm, rel=0.3)


def test_what_is_counted_has_no_uncertainty_and_no_marginal_zone():
    assert (counted(300).u, counted(300).unknown) == (None, COUNTED)
    assert (yes_or_no(True).value, yes_or_no(False).value) == (1.0, 0.0)
    took = timed(0.12, 0.02, 0.02)
    assert took.u == pytest.approx(0.01 * sqrt(2 / 3))
    assert took.even == pytest.approx(0.01 / sqrt(3))


# -- the distribution behind a verdict --------------------------------------------------------------------------------


@pytest.mark.parametrize(("share", "k"), [(0.0, 2.0), (1.0, sqrt(3) * 0.9545)])
def test_the_coverage_factor_is_that_of_the_normal_and_of_the_even_distribution(share, k):
    assert coverage_factor(share) == pytest.approx(k, rel=1e-4)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.95, 1.0])
def test_the_distribution_is_that_of_a_sum_of_an_even_and_a_normal_error(share):
    rng = np.random.default_rng(7)
    errors = share * sqrt(3) * rng.uniform(-1, 1, 200_000) + sqrt(1 - share**2) * rng.standard_normal(200_000)
    for x in (-2.0, -0.5, 0.0, 1.0, 1.7):
        assert cumulative(x, 1.0, share) == pytest.approx(np.mean(errors < x), abs=0.004)
    assert np.mean(np.abs(errors) < coverage_factor(share)) == pytest.approx(0.9545, abs=0.003)


def test_conformity_is_the_probability_of_lying_within_both_limits():
    assert conformity(1.0, 0.1, 0.0, 2.0) == pytest.approx(1.0)
    assert conformity(1.0, 0.1, 1.0, None) == pytest.approx(0.5)
    assert conformity(1.0, 1.0, 0.0, 2.0) == pytest.approx(0.6827, abs=1e-4)
    assert conformity(1.0 + guard_factor(0.0) * 0.1, 0.1, 1.0, None) == pytest.approx(0.975)


@pytest.mark.parametrize(
    ("value", "U", "limits", "shown"),
    [(463.2, 4.1, [], 0), (463.2, 1.7, [], 1), (2.0239, 0.024, [], 3), (2.0239, 0.05, [], 2), (501.3, 4.0, [501.12], 1),
     (500.6, 4.0, [501.0], 1), (0.0, 0.0, [], 0)],
)  # fmt: skip
def test_value_and_uncertainty_have_the_digits_that_the_uncertainty_is_worth(value, U, limits, shown):
    assert decimals(value, U, limits) == shown


# -- the instruments of the virtual bench -----------------------------------------------------------------------------


def test_the_simulated_sensors_are_what_the_data_sheets_of_the_virtual_bench_say():
    entries = load("astb").entries
    pieces = ordinary().pieces
    assert set(pieces) == {name for names in BY_GROUP.values() for name in names}
    for name, piece in pieces.items():
        k, one = sensor_of(name), piece.instrument
        for simulated, told in (
            ("accuracy", one.offset),
            ("noise", one.noise),
            ("resolution", one.resolution),
        ):
            assert entries[f"sensor_{simulated}"].value[k] == pytest.approx(told), (name, simulated)
        row = TABLE[name].group.row
        assert (one.name, one.type, one.nonlinearity) == (row.instrument, row.type, 0.0)
        assert (one.gain, one.lag) == pytest.approx((row.gain, row.lag / 10))
        assert abs(entries["sensor_gain"].value[k]) <= one.gain


@pytest.mark.parametrize("unit", [name for name, one in UNITS.items() if one.si == "Pa"])
def test_an_instrument_may_be_described_in_any_unit_of_its_quantity(tmp_path, unit):
    path = tmp_path / "ours.toml"
    path.write_text(f"""
[instrument.gauge]
offset = {{ value = 2.0, unit = "{unit}", provenance = "data sheet", source = "x" }}
[signal]
"left.bellows_pressure" = {{ instrument = "gauge" }}
""")
    offset = read_instruments(path).pieces["left.bellows_pressure"].instrument.offset
    assert offset == 2.0 * UNITS[unit].factor


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (('unit = "mm"', 'unit = "bar"'), "instrument.laser.offset = 0.05 bar has the wrong unit; use m or "),
        (('"left.height"', '"left.hight"'), "did you mean 'left.height'?"),
        (('instrument = "laser"', 'instrument = "lazer"'), "did you mean 'laser'?"),
        (("offset", "ofset"), "instrument.laser.ofset is not a key"),
        (("value = 0.05", "value = -0.05"), "is not a half-width"),
        (('source = "x"', 'source = " "'), "source is empty"),
        (("due = 2027-02-03", 'due = "2027-02-03"'), "is not a date"),
        (("due = 2027-02-03", "due = 2027-02-03T12:00:00"), "is not a date"),
        (("[signal]", "[[signal]]"), "signal = [{'left.height': "),
    ],
)
def test_an_invalid_file_is_refused_with_key_and_value(tmp_path, change, why):
    path = tmp_path / "ours.toml"
    text = """
[instrument.laser]
type = "laser"
offset = { value = 0.05, unit = "mm", provenance = "data sheet", source = "x" }
[signal]
"left.height" = { instrument = "laser", serial_number = "7", certificate = "C1", due = 2027-02-03 }
"""
    path.write_text(text)
    assert read_instruments(path).pieces["left.height"].instrument.offset == pytest.approx(0.05 * mm)
    path.write_text(text.replace(*change, 1))
    with pytest.raises(InstrumentsError) as error:
        read_instruments(path)
    assert why in str(error.value)
    assert str(path) in str(error.value)


def test_a_checks_probability_decides_between_pass_marginal_and_fail():
    bench = SimpleNamespace(clock=VirtualClock(), wiring=SimpleNamespace(rig="fake"))
    run = Run(bench, SimpleNamespace(event=lambda *args, **data: None))
    for value, verdict, conforms in ((5.3, "pass", 0.9987), (5.1, "marginal", 0.8413), (4.9, "fail", 0.1587)):
        run.check("pressure", Measured(value * bar, 0.1 * bar), "bar", low=5.0 * bar)
        assert run.checks[-1].verdict.value == verdict
        assert run.checks[-1].conformity == pytest.approx(conforms, abs=1e-4)
    assert (
        str(run.checks[1])
        == "pressure = 5.10 ± 0.20 bar (k = 2; at least 5 bar): marginal, conforms with 84.1 % probability"
    )


@pytest.mark.parametrize(
    ("value", "u", "verdict"),
    [(1.2, 0.3, "not available"), (0.5, 0.3, "not available"), (9.0, 0.3, "fail"), (1.2, 0.2, "fail")],
)
def test_a_value_that_limits_cannot_judge_is_not_available(value, u, verdict):
    """Limits from 0 to 1, U = 2 u: no value could pass with U above 0.5, but one can be surely outside."""
    bench = SimpleNamespace(clock=VirtualClock(), wiring=SimpleNamespace(rig="fake"))
    run = Run(bench, SimpleNamespace(event=lambda *args, **data: None))
    run.check("pressure", Measured(value * bar, u * bar), "bar", low=0.0, high=1.0 * bar)
    assert run.checks[-1].verdict.value == verdict


def test_a_check_that_was_measured_while_ticks_were_late_is_marked():
    late = {"rig.late_ticks": 5.0}
    bench = SimpleNamespace(
        clock=VirtualClock(),
        wiring=SimpleNamespace(rig="fake"),
        readings=SimpleNamespace(glimpse=late.__getitem__),
    )
    run = Run(bench, SimpleNamespace(event=lambda *args, **data: None))
    run.check("before any phase", 1.0, "bar", low=0.0)
    with run.phase("quiet"):
        run.check("quiet", 1.0, "bar", low=0.0)
    with run.phase("disturbed"):
        late["rig.late_ticks"] += 7
        run.check("inside", 1.0, "bar", low=0.0)
    run.check("after", 1.0, "bar", low=0.0, note="of this phase")
    with run.phase("quiet again"):
        run.check("quiet again", 1.0, "bar", low=0.0)
    assert run.disturbed == {"inside": 7, "after": 7}
    assert [bool(one.note) for one in run.checks] == [False, False, True, True, False]


# -- time stamps -------------------------------------------------------------------------------------------------------


def _phase(readings, frequency=2.0, rate=200.0):
    times = np.arange(len(readings["left.height"])) / rate
    turn = np.exp(-1j * tau * frequency * times)
    return float(np.angle((readings["load_cell.1"] @ turn) / (readings["left.height"] @ turn)))


@pytest.mark.parametrize(("clock", "within"), [("hardware", 5e-6), ("system", 900e-6)])
def test_the_uncertainty_of_a_phase_includes_the_clocks(clock, within):
    times = np.arange(400) / 200.0
    sines = {
        "left.height": 5 * mm * np.sin(tau * 2 * times),
        "load_cell.1": 9e3 * np.sin(tau * 2 * times + 0.1),
    }
    perfect = instruments(offset=0.0, gain=0.0)
    apart = {name: Stamp(clock, within, f"bus.{name}") for name in sines}
    (found,) = measured(_phase, sines, instruments=perfect, rate=200.0, stamps=apart)
    assert found.value == pytest.approx(0.1)
    assert found.u == pytest.approx(tau * 2 * within / sqrt(3) * sqrt(2), rel=0.02)
    assert set(found.parts) == {f"time stamps by the {clock}"}
    together = {name: Stamp(clock, within, "bus") for name in sines}
    (same,) = measured(_phase, sines, instruments=perfect, rate=200.0, stamps=together)
    assert same.u < 1e-3 * found.u, "samples with one stamp have one delay"
