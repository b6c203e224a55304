"""Values that look valid and are no measurements: codes, rails and stuck readings are found, sound columns are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_records.tables.quality import CHECKS, examine
from bench_records.tables.reading import Series

TIME = np.arange(0.0, 20.0, 0.01)
WAY = 20.0 * np.abs((TIME / 2.0) % 2.0 - 1.0)
NOISE = np.random.default_rng(1).standard_normal(len(TIME))
PUSH = 150.0 + WAY + 0.1 * NOISE


def found(columns: dict[str, np.ndarray], nulls=None, inputs=()) -> tuple[dict[str, Series], dict[str, str]]:
    series = {name: Series(name, TIME[: len(one)], one) for name, one in columns.items()}
    clean, remarks = examine("a.csv", series, nulls or {}, inputs)
    return clean, {one.check: one.column for one in remarks}


def with_code(values: np.ndarray, code: float, share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    places = np.zeros(len(values), np.bool_)
    while places.sum() < share * len(values):
        at = rng.integers(len(values))
        places[at : at + rng.integers(1, 6)] = True
    return np.where(places, code, values), places


@given(
    st.sampled_from((9.9e37, -9.9e37, -9999.0, 1e6, 65535.0, -32768.0, 0.0, 999.9, 300.0)),
    st.floats(0.001, 0.05),
    st.integers(0, 10_000),
)
def test_a_code_in_place_of_samples_is_left_out_with_a_doubt(code: float, share: float, seed: int) -> None:
    values, places = with_code(PUSH, code, share, seed)
    clean, checks = found({"force": values, "way": WAY})
    assert checks == {"undeclared code": "force"} and CHECKS["undeclared code"].doubt
    assert np.array_equal(np.isnan(clean["force"].values), places)
    declared, checks = found({"force": values, "way": WAY}, {"force": [code]})
    assert checks == {"declared code": "force"} and not CHECKS["declared code"].doubt
    assert np.array_equal(declared["force"].values, clean["force"].values, equal_nan=True)


def test_what_is_declared_to_be_a_measurement_stays() -> None:
    values, _ = with_code(PUSH, 160.0, 0.01, 3)
    assert "undeclared code" in found({"force": values, "way": WAY})[1]
    clean, checks = found({"force": values, "way": WAY}, {"force": []})
    assert "undeclared code" not in checks and np.array_equal(clean["force"].values, values)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.4])
@pytest.mark.parametrize("low", [True, False])
def test_a_rail_is_a_doubt_and_of_an_output_left_out(share: float, low: bool) -> None:
    rail = np.quantile(PUSH, share if low else 1.0 - share)
    values = np.maximum(PUSH, rail) if low else np.minimum(PUSH, rail)
    clean, checks = found({"force": values, "way": WAY})
    assert checks == {"saturation": "force"} and CHECKS["saturation"].doubt
    assert np.array_equal(np.isnan(clean["force"].values), values == rail)
    kept, checks = found({"force": values, "way": WAY}, inputs=("force",))
    assert checks == {"saturation": "force"} and np.array_equal(kept["force"].values, values)


@pytest.mark.parametrize("seconds", [0.5, 6.0])
@pytest.mark.parametrize("stuck", ["force", "way"])
@pytest.mark.parametrize("begin", [4.7, 6.1, 11.3])
def test_a_stuck_reading_is_a_doubt(seconds: float, stuck: str, begin: float) -> None:
    columns = {"force": PUSH.copy(), "way": WAY.copy(), "push": 3.0 + 0.1 * WAY + 1e-3 * NOISE[::-1]}
    held = (begin <= TIME) & (begin + seconds > TIME)
    columns[stuck][held] = columns[stuck][held][0]
    _, checks = found(columns)
    assert checks == {"stuck": stuck}


#: Sound columns that look like something else.
SOUND = {
    "noise": NOISE,
    "rounded noise": np.round(NOISE, 1),
    "triangle": WAY,
    "square": np.sign(np.sin(TIME)),
    "noisy trapezoid": np.clip(WAY, 5.0, 15.0) + 0.02 * NOISE,
    "set-points": np.floor(TIME) * 3.0 % 7.0,
    "steps with noise": np.floor(TIME / 4.0) + 0.01 * NOISE,
    "rest, then motion": np.where(TIME > 18.0, 30.0 * np.sin(9.0 * TIME), 0.0) + 0.01 * NOISE,
    "rest, then a triangle": np.where(TIME > 18.0, 20.0 * WAY, 0.0) + 0.01 * NOISE,
    "valve": (TIME % 5.0 < 0.1).astype(float),
    "constant": np.full(len(TIME), 3.0),
    "sine": np.sin(TIME),
    "rounded sine": np.round(np.sin(TIME), 2),
    "fast sine": np.sin(140.0 * TIME),
    "random walk": np.cumsum(NOISE),
    "decay": np.exp(-TIME),
    "held": np.repeat(PUSH[::20], 20),
    "rounded at rest": np.round(3.0 * np.sin(np.maximum(TIME - 5.0, 0.0)) + 0.001 * NOISE, 2),
}


@pytest.mark.parametrize("kind", SOUND)
def test_a_sound_column_is_not_doubted(kind: str) -> None:
    columns = {"x": SOUND[kind], "way": WAY, "force": PUSH}
    for inputs in ((), ("x",)):
        clean, checks = found(columns, inputs=inputs)
        assert not [check for check in checks if CHECKS[check].doubt]
        assert np.array_equal(clean["x"].values, SOUND[kind])


def test_a_motion_with_holds_is_not_clipped() -> None:
    way = np.clip(WAY, 5.0, 15.0)
    _, checks = found({"force": 150.0 + way + 0.1 * NOISE, "way": way, "pressure": 3.0 + 0.1 * way})
    assert not checks


@given(st.integers(0, 10_000), st.integers(1, 200), st.floats(0.0, 3.0))
def test_random_smooth_columns_with_noise_are_not_doubted(seed: int, size: int, rounding: float) -> None:
    rng = np.random.default_rng(seed)
    motion = np.interp(TIME, np.linspace(0.0, 20.0, size + 1), np.cumsum(rng.standard_normal(size + 1)))
    values = motion + 0.01 * rng.standard_normal(len(TIME))
    values = np.round(values, round(rounding))
    _, checks = found({"x": values, "way": WAY})
    assert not [check for check in checks if CHECKS[check].doubt]


def test_short_and_empty_columns_are_taken_as_they_are() -> None:
    for values in (np.empty(0), np.full(40, np.nan), np.array([1.0, 9999.0])):
        clean, checks = found({"x": values, "way": WAY})
        assert not checks and np.array_equal(clean["x"].values, values, equal_nan=True)


@pytest.mark.parametrize("bulk", [3.0, 0.0])
@pytest.mark.parametrize("size", [12, 100])
def test_a_huge_error_code_is_found_among_constant_values(bulk: float, size: int) -> None:
    values = np.full(size, bulk)
    values[5] = 9.9e37
    clean, checks = found({"pressure": values})
    assert checks == {"undeclared code": "pressure"} and np.isnan(clean["pressure"].values[5])


def test_an_error_code_among_few_values_is_found_but_not_a_switch() -> None:
    values = np.where(TIME < 10.0, 2.0, 3.0)
    assert not found({"x": values})[1]
    values[100:103] = -9999.0
    assert found({"x": values})[1] == {"undeclared code": "x"}


def test_a_peak_before_a_gap_in_time_is_no_code() -> None:
    times = np.concatenate((TIME[:300], TIME[300:] + 5.0))
    values = PUSH + np.where(TIME < 3.0, 5.0 * np.maximum(TIME - 2.9, 0.0) / 0.01, 0.0)
    series = {"force": Series("force", times, values), "way": Series("way", times, WAY)}
    assert not examine("a.csv", series, {})[1]


@given(st.integers(20, 1900), st.sampled_from((13.0, 18.0, 22.0)))
def test_one_peak_is_no_code_because_another_sample_has_the_same_value(at: int, height: float) -> None:
    """A single peak below 25 usual steps is a shock, also if the rounded reading passes the same value smoothly."""
    ramp = np.round(5.0 * WAY, 1)  # 0.5 a sample
    values = ramp.copy()
    values[at] = np.round(values[at] + height * 0.5, 1)
    _, checks = found({"force": values, "way": WAY})
    assert "undeclared code" not in checks
