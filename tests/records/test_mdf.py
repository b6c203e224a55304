"""MDF files of others: every channel has its own clock, and what may be two things is named with file and group."""

from pathlib import Path

import can
import numpy as np
import pytest

from astb.exchange import import_file
from astb.frames_import import LogKeys
from bench_protocol.account import Account
from bench_records.importing import ImportKeys, read_mdf
from bench_records.layout import RecordError, SignalInfo
from bench_records.record import read
from bench_records.tables.keys import FileKeys, Source, TimeSource
from bench_records.tables.reading import read_series
from diagnosis.contracts import DiagnosisError
from diagnosis.systems.mapping import read_mapped
from tests.diagnosis.test_mapping import FORCE, PRESSURE, TIME, X, write_map
from tools.generate.readers_page import table

asammdf = pytest.importorskip("asammdf", reason="MDF needs the extra mdf: `make test-mdf`")
pytestmark = pytest.mark.mdf

SIGNALS = {
    "left.height": SignalInfo("left.height", "mm", 1e-3),
    "rig.state": SignalInfo("rig.state", names={1: "ok", 2: "off"}),
}


def write(path: Path, *groups: list) -> Path:
    with asammdf.MDF(version="4.10") as mdf:
        for group in groups:
            mdf.append(group)
        mdf.save(path)
    return path


def signal(name: str, values, times=TIME, unit: str = "", texts: dict | None = None):
    conversion = None
    if texts:
        from asammdf.blocks.conversion_utils import from_dict

        pairs = list(texts.items())
        mapping = {f"val_{k}": value for k, (value, _) in enumerate(pairs)}
        mapping |= {f"text_{k}": text for k, (_, text) in enumerate(pairs)} | {"default": ""}
        conversion = from_dict(mapping)
    return asammdf.Signal(np.asarray(values), np.asarray(times), name=name, unit=unit, conversion=conversion)


def mapped(path: Path, folder: Path, change: tuple[str, str] = ("", "")):
    mapping = write_map(folder, change=('column = "t"\nunit = "ms"\nstep = "10 ms"\n', ""))
    mapping.write_text(mapping.read_text().replace(*change))
    return read_mapped([path], mapping)[1]


def test_clocks_that_are_a_little_apart_are_no_gaps(tmp_path) -> None:
    path = write(
        tmp_path / "a.mf4", [signal("x", X), signal("F", FORCE)], [signal("p", PRESSURE, TIME + 20e-9)]
    )
    (run,) = mapped(path, tmp_path).runs
    assert run.experiment.step == pytest.approx(0.01)
    assert np.isfinite(run.outputs).all() and len(run.outputs) >= len(TIME) - 1
    assert run.experiment.inputs["pressure"] == pytest.approx(1e5 * PRESSURE[: len(run.outputs)], abs=10.0)


def test_a_slow_channel_has_intervals_and_gaps_of_its_own(tmp_path) -> None:
    slow = TIME[::10]
    smooth = 5.0 + 0.1 * slow
    path = write(tmp_path / "a.mf4", [signal("x", X), signal("F", FORCE)], [signal("p", smooth, slow)])
    (run,) = mapped(path, tmp_path).runs
    grid = run.experiment.time + 0.0
    assert run.experiment.step == pytest.approx(0.01)
    assert run.experiment.inputs["pressure"] == pytest.approx(1e5 * (5.0 + 0.1 * grid))


def test_a_name_in_two_groups_is_refused_with_them_or_chosen(tmp_path) -> None:
    path = write(
        tmp_path / "a.mf4",
        [signal("x", X), signal("F", FORCE), signal("p", PRESSURE)],
        [signal("p", PRESSURE + 4)],
    )
    with pytest.raises(
        DiagnosisError, match=r'a\.mf4: pressure.column = "p": there are 2 such channels, in group 0.*group 1'
    ):
        mapped(path, tmp_path)
    data = mapped(path, tmp_path, ('column = "p"', 'column = "p", group = 1'))
    assert data.runs[0].experiment.inputs["pressure"] == pytest.approx(1e5 * (PRESSURE + 4))
    height = [signal("left.height", X, unit="mm")]
    both = write(tmp_path / "b.mf4", height, height)
    with pytest.raises(
        RecordError, match=r'the channel = "left.height": there are 2 such channels, in group 0'
    ):
        read_mdf(both, tmp_path / "o", SIGNALS.get, {}, Account(), ImportKeys())
    assert read_mdf(both, tmp_path / "o", SIGNALS.get, {}, Account(), ImportKeys(group=1)) == len(X)


def test_texts_with_numbers_are_states_and_others_refused_or_raw(tmp_path) -> None:
    values = np.where(TIME < 1.0, 1, 2).astype(np.uint8)
    path = write(tmp_path / "a.mf4", [signal("rig.state", values, texts={1: "ok", 2: "off"})])
    assert read_mdf(path, tmp_path / "o", SIGNALS.get, {}, Account(), ImportKeys()) == len(TIME)
    np.testing.assert_array_equal(read(tmp_path / "o").series("rig.state")[1], values)
    source = {"force": Source(column="rig.state")}
    with pytest.raises(
        RecordError, match=r'rig.state of group 0.* has texts, such as "off", "ok"; .* raw = true'
    ):
        read_series(path, FileKeys(), TimeSource(), source, Account())
    raw = {"force": Source(column="rig.state", raw=True)}
    np.testing.assert_array_equal(
        read_series(path, FileKeys(), TimeSource(), raw, Account())["force"].values, values
    )


def test_what_is_no_mdf_file_or_falls_is_refused_in_words(tmp_path) -> None:
    (tmp_path / "a.mf4").write_bytes(b"rubbish" * 100)
    (tmp_path / "b.mf4").write_bytes(b"MDF     4.10    " + b"\xff" * 400)
    for name, said in (("a", "does not begin with MDF"), ("b", "is damaged, or asammdf cannot")):
        with pytest.raises(RecordError, match=rf"{name}\.mf4 is .*{said}|{said}"):
            read_series(
                tmp_path / f"{name}.mf4", FileKeys(), TimeSource(), {"x": Source(column="x")}, Account()
            )
    path = write(tmp_path / "c.mf4", [signal("x", X, np.where(TIME < 2.0, TIME, TIME - 1.5))])
    with pytest.raises(
        RecordError, match=r"x, group 0.*: the clock falls from 1.99 s to 0.5 s in sample 201"
    ):
        read_series(path, FileKeys(), TimeSource(), {"x": Source(column="x")}, Account())


DBC = 'VERSION ""\nBU_: Rig\nBO_ 256 Heights: 8 Rig\n SG_ Left : 0|16@1- (0.1,0) [0|0] "mm" Rig\n'
DBC += 'BO_ 257 Long: 24 Rig\n SG_ Last : 160|16@1+ (1,0) [0|0] "N" Rig\n'


def test_raw_bus_logging_is_decoded_as_any_log_of_frames(tmp_path) -> None:
    path, dbc = tmp_path / "bus.mf4", tmp_path / "rig.dbc"
    dbc.write_text(DBC)
    start = 1_700_000_000.0
    with can.Logger(path) as log:
        for k in range(50):
            data = (10 * k - 100).to_bytes(2, "little", signed=True) + bytes(6)
            log.on_message_received(can.Message(start + 0.01 * k, 256, False, data=data, channel=1))
            long = bytes(20) + (3 * k).to_bytes(2, "little") + bytes(2)
            log.on_message_received(
                can.Message(start + 0.01 * k + 0.002, 257, False, data=long, is_fd=True, channel=1)
            )
        log.on_message_received(can.Message(start + 0.6, is_error_frame=True, channel=1))
    with pytest.raises(RecordError, match="holds bus frames without signals; decode them with --dbc"):
        import_file(path, tmp_path / "none")
    said = import_file(path, tmp_path / "o", LogKeys(dbc=dbc))
    assert said.startswith("100 samples") and "1 error frame" in said
    record = read(tmp_path / "o")
    times, values = record.series("Heights.Left")
    np.testing.assert_allclose(values, (10 * np.arange(50) - 100) * 0.1)
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-6)
    np.testing.assert_allclose(record.series("Long.Last")[1], 3 * np.arange(50))


def test_every_row_of_the_page_has_its_test() -> None:
    assert {f"test_{form.name.replace(' ', '_')}" for form in table("mdf").forms} <= set(globals())
