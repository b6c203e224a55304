"""A signed report states who, what, when, with which instruments, of which files, and the unknown entries."""

import hashlib
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_records.comparison import compare_runs
from bench_records.recorder import Recorder
from bench_records.report import write_report
from bench_records.result import SpecimenFacts, check, conclude
from bench_records.signing import SHORT, footing
from bench_records.typography import MINUS, primed, unit, with_uncertainty

PIECE = {"type": "laser", "serial_number": "L-0815", "certificate": "2026-117"}
DATES = {"calibrated": "2026-02-03", "due": "2027-02-03"}
META = {
    "date": "2026-11-22T21:33:05Z",
    "operator": "A. Tester",
    "ambient": "21 °C, 1013 hPa",
    "commit": "0123456789ab",
    "time": "real",
    "parameters": {"name": "astb", "sha256": "ab" * 32},
    "versions": {"astb": "0.1.0"},
    "instruments": {
        "file": "hall.toml",
        "sha256": "cd" * 32,
        "pieces": [
            {"signal": "left.height", **PIECE, **DATES},
            {"signal": "right.height", **PIECE, **DATES},
            {"signal": "load_cell.1", **PIECE, **DATES, "serial_number": "F-1"},
        ],
    },
}
WAYS = ("Move `bolster_mass`.\n\nGood is K'' at rest.", "K'' at 1 Hz")


def run_in(directory: Path, meta: dict) -> str:
    with Recorder(directory, [], meta, start_ns=0) as recorder:
        recorder.event(1_000_000_000, "check", "K'' at 1 Hz = 5 kN*s/m: pass")
        recorder.event(2_000_000_000, "state", "ACTIVE")
    one = check(WAYS[1], 5e3, "kN*s/m", 1e3, low=4e3, high=6e3, u=1e2, parts={"laser offset": 1e2}, at=1.0)
    sample = SpecimenFacts(type="diaphragm 575", serial_number="S-4711", drawing="D-12")
    conclude("plan", "Title", WAYS[0], [one], specimen=sample, rig="hall").write(directory)
    return write_report(directory).read_text(encoding="utf-8")


def words(page: str) -> str:
    text = re.sub(r"<(script|style|svg).*?</\1>", " ", page, flags=re.DOTALL)
    return re.sub(r"[ \n]+", " ", re.sub(r"<[^>]+>", " ", text))


def test_what_a_signature_rests_on(tmp_path: Path) -> None:
    text = words(run_in(tmp_path, META))
    for told in (
        "date 2026-11-22 21:33:05 UTC",
        "operator A. Tester",
        "specimen diaphragm 575",
        "serial number S-4711",
        "drawing D-12",
        "ambient 21 °C, 1013 hPa",
        "parameter set astb",
        "software astb 0.1.0, commit 0123456789ab",
        "left height, right height laser L-0815 2026-117 2026-02-03 2027-02-03",
        "load cell 1 laser F-1 2026-117",
        "tested by A. Tester date signature checked by date signature approved by",
    ):
        assert told in text
    for name in ("record.parquet", "result.json"):
        assert f"{name} {hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()}" in text
    assert "not recorded" not in text


def test_a_missing_entry_leaves_a_line_to_fill_in(tmp_path: Path) -> None:
    page = run_in(tmp_path, {"time": "real"})
    for name in ("date", "operator", "ambient"):
        assert f'<dt>{name}</dt><dd><small class="blank">not recorded</small></dd>' in page
    assert "Instruments" not in words(page)


def test_units_and_symbols_are_set_and_events_repeat_no_check(tmp_path: Path) -> None:
    page = run_in(tmp_path, META)
    text = words(page)
    assert "`" not in text and "<code>bolster_mass</code>" in page
    assert "K″ at 1 Hz" in text and "kN·s/m" in text and "kN*s/m" not in text and "K''" not in text
    assert "state ACTIVE" in text
    assert text.count("K″ at 1 Hz") == 2, "in the table, and as the least sure of all"


def test_a_comparison_does_not_list_every_piece(tmp_path: Path) -> None:
    for name, meta in (("a", META), ("b", META | {"operator": "B. Tester"})):
        (tmp_path / name).mkdir()
        run_in(tmp_path / name, meta)
    found = compare_runs(tmp_path / "a", tmp_path / "b")
    assert [(fact.what, fact.b) for fact in found.facts] == [("operator", "B. Tester")]


@given(plan=st.text(max_size=20), serial=st.text(max_size=20))
def test_no_text_ends_the_string_at_the_foot(plan: str, serial: str) -> None:
    result = conclude(
        plan, "", "", [check("x", 1.0, low=0)], specimen=SpecimenFacts(type="", serial_number=serial)
    )
    written = footing(result, [("record.parquet", "0123456789abcdef")])
    assert re.fullmatch(r"(?:[A-Za-z0-9]|\\[0-9a-f]+ )*", written)
    read = re.sub(r"\\([0-9a-f]+) ", lambda m: chr(int(m[1], 16)), written)
    assert read.startswith(plan) and serial in read and read.endswith("0123456789abcdef"[:SHORT])


@pytest.mark.parametrize(
    ("typed", "printed"),
    [
        ("kN*s/m", "kN·s/m"),
        ("m2", "m²"),
        ("m3/(s*Pa)", "m³/(s·Pa)"),
        ("g/(min*bar2)", "g/(min·bar²)"),
        ("deg", "°"),
        ("1", ""),
    ],
)
def test_units_as_they_are_printed(typed: str, printed: str) -> None:
    assert unit(typed) == printed


def test_primes_are_set_and_apostrophes_stay() -> None:
    assert primed("K' and K'' at 1 Hz: the spring's") == "K′ and K″ at 1 Hz: the spring's"


@given(
    value=st.floats(-1e12, 1e12, allow_subnormal=False),
    half=st.floats(1e-12, 1e12),
)
def test_value_and_uncertainty_end_with_the_same_digit(value: float, half: float) -> None:
    first, second = (text.replace("\u2009", "") for text in with_uncertainty(value, half))
    assert first.partition("·")[2] == second.partition("·")[2]
    mantissa, error = first.partition("·")[0], second.partition("·")[0]
    assert len(mantissa.partition(".")[2]) == len(error.partition(".")[2])
    assert "e" not in first + second
    power = first.partition("·10")[2].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    factor = 10.0 ** int(power or 0)
    # Half of the last digit, which is worth a tenth of the uncertainty at least.
    assert abs(float(mantissa.replace(MINUS, "-")) * factor - value) <= 0.51 * half + 1e-9 * abs(value)
    assert 0.5 * half < float(error) * factor < 1.5 * half
