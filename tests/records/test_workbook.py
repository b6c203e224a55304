"""Workbooks for Excel, as pandas reads them with another library: the same numbers, and no text becomes a formula."""

import msgspec
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from astb.commands.exchange import export_command
from astb.exit_codes import MISUSE, PASS
from bench_records import workbook
from bench_records.index import KeptCheck, KeptRun
from bench_records.layout import RecordError
from bench_records.record import read
from bench_records.result import read_result
from bench_records.trend import trend_of
from tests.refusals import refuses

pytest.importorskip("xlsxwriter")
pytest.importorskip("openpyxl")


def test_a_run_is_written_with_its_checks_its_curves_and_its_record(failed_run, tmp_path) -> None:
    path, rate = tmp_path / "run.xlsx", 2.0
    done = CliRunner().invoke(
        export_command, [str(failed_run), str(path), "--rate", f"{rate}", "--signal", "left.height"]
    )
    assert done.exit_code == PASS, done.output
    book = pd.read_excel(path, sheet_name=None)
    result, record = read_result(failed_run), read(failed_run)
    facts = dict(book["run"].iloc[:, :2].values.tolist())
    assert (facts["plan"], facts["verdict"]) == (result.plan, result.verdict)
    checks = book["checks"]
    assert checks["check"].tolist() == [one.name for one in result.checks]
    assert checks["verdict"].tolist() == [one.verdict.value for one in result.checks]
    for column, of in (
        ("value", lambda one: one.number),
        ("± U", lambda one: one.expanded),
        ("low", lambda one: one.low),
        ("high", lambda one: one.high),
    ):
        wanted = [np.nan if (n := of(one)) is None else n / one.scale for one in result.checks]
        np.testing.assert_allclose(checks[column].astype(float), wanted, rtol=1e-12, err_msg=column)
    assert len(book["curves"]) == sum(len(one.xs) for one in result.curves)
    frame = record.frame(["left.height"], rate)
    np.testing.assert_allclose(book["record"]["left.height [mm]"], 1e3 * frame["left.height"], rtol=1e-12)
    np.testing.assert_allclose(book["record"]["time_s"], frame.index)


def test_data_beyond_excel_are_refused_without_a_file(failed_run, tmp_path, monkeypatch) -> None:
    path = tmp_path / "run.xlsx"
    monkeypatch.setattr(workbook, "ROWS", 100)
    done = CliRunner().invoke(export_command, [str(failed_run), str(path), "--rate", "100"])
    assert done.exit_code == MISUSE and "a rate of" in done.output and not path.exists()
    monkeypatch.setattr(workbook, "installed", lambda extra: False)
    with refuses(RecordError, "xlsxwriter"), workbook.workbook(path):
        pass


EVIL = "=cmd|' /C calc'!A0"


def test_trends_have_dates_numbers_and_texts(tmp_path) -> None:
    run = KeptRun(
        **dict.fromkeys(KeptRun.__struct_fields__, "")
        | {"directory": EVIL, "plan": "aw0", "seed": 1, "duration": 1.0, "parameters": {}}
    )
    checks = [
        KeptCheck(
            run=msgspec.structs.replace(run, began=f"2026-03-0{day}T10:00:00Z"),
            phase="main", name=EVIL, value=1e3 * day, unit="kN", scale=1e3, low=0.0, high=None,
            verdict="pass", expanded=100.0,
        )
        for day in (1, 2, 3, 5)
    ]  # fmt: skip
    missing = msgspec.structs.replace(checks[0], value=None, verdict="error", expanded=None)
    workbook.write_trends_book([trend_of(EVIL, checks), trend_of("b", [missing])], tmp_path / "t.xlsx")
    book = pd.read_excel(tmp_path / "t.xlsx", sheet_name=None)
    assert book["trends"]["check"].tolist() == [EVIL, "b"]
    assert book["trends"].loc[0, ["runs", "mean", "drift a day"]].tolist() == [4, 2.75, pytest.approx(1.0)]
    values = book["values"]
    assert values["when (UTC)"].tolist()[:2] == [pd.Timestamp(f"2026-03-0{day} 10:00") for day in (1, 2)]
    assert values["value"].tolist()[:4] == [1.0, 2.0, 3.0, 5.0] and np.isnan(values["value"][4])
    assert set(values["run"]) == {EVIL}
