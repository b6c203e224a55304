"""Records go to other programs and back: python-can, cantools, pandas and asammdf read the recorded values."""

import shutil
import subprocess
from pathlib import Path

import can
import cantools
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from astb.commands.exchange import export_command, import_command
from astb.exit_codes import MISUSE, PASS
from bench_protocol.frames import FRAME
from bench_protocol.table import TABLE
from bench_records.checksums import SUMS, broken_files
from bench_records.record import read
from drivers import can_log
from drivers.can_files.frames import CanLogError
from drivers.can_log import CanLog, read_frames, write_frames
from tests.refusals import refuses

DBC = Path(__file__).resolve().parents[2] / "bench_protocol" / "generated" / "astb.dbc"


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A short run that kept its frames."""
    from astb.rig_file import RigFile, Simulation
    from astb.run import Keeping, run_plans
    from test_plans.plan import plan

    def rest(bench_run) -> None:
        """Rest: do nothing for a second."""
        bench_run.bench.wait(1.0)
        bench_run.check("one", 1.0, "1", low=0.0)

    out = tmp_path_factory.mktemp("runs")
    nothing = lambda run: None  # noqa: E731
    plans = [plan(setup=nothing, teardown=nothing)(rest)]
    rig = RigFile(name="here", simulation=Simulation(), time="virtual")
    run_plans(plans, rig, out, virtual=True, seed=3, out=out, keeping=Keeping("A. Tester", frames=True))
    return out / "rest"


def command(which, *arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(which, list(map(str, arguments)))
    return done.exit_code, done.output


def same_samples(one: Path, other: Path, within: float = 0.0) -> None:
    a, b = read(one), read(other)
    assert len(a) == len(b) > 1000
    for name in a.signals:
        (times, values), (others, back) = a.series(name), b.series(name)
        np.testing.assert_array_equal(values, back, err_msg=name)
        assert times.size == others.size
        if times.size > 1:  # a file of frames begins with its first frame
            np.testing.assert_allclose(np.diff(times), np.diff(others), atol=within, rtol=0)


@pytest.mark.parametrize("ending", ["blf", "asc", "log", "trc"])
def test_frames_go_through_every_format_and_give_the_same_samples(run: Path, tmp_path, ending: str) -> None:
    target = tmp_path / f"bus.{ending}"
    assert command(export_command, run, target)[0] == PASS
    assert command(import_command, target, tmp_path / "back")[0] == PASS
    # ASC and TRC write time with six digits behind the point of a second, or of a millisecond fewer.
    same_samples(run, tmp_path / "back", within=2e-4)
    assert "nothing was judged here" in (tmp_path / "back" / "report.html").read_text()


def test_cantools_reads_in_the_kept_frames_what_the_record_says(run: Path) -> None:
    base = cantools.database.load_file(DBC)
    message = next(one for one in base.messages if any("height" in signal.name for signal in one.signals))
    decoded = [
        message.decode(frame.data)
        for frame in can.LogReader(run / "can.blf")
        if frame.arbitration_id == message.frame_id
    ]
    record = read(run)
    signal = next(one for one in message.signals if "height" in one.name)
    name = next(row.name for row in TABLE.signals if row.name.replace(".", "_") == signal.name)
    theirs = np.array([one[signal.name] for one in decoded], float) * record.signals[name].scale
    np.testing.assert_allclose(theirs, record.series(name)[1], rtol=1e-12)


def test_the_commands_of_the_bench_are_among_the_kept_frames(run: Path) -> None:
    ours = {message.identifier for message in TABLE.messages if not message.from_rig}
    received = {int(identifier) for block in read_frames(run / "can.blf") for identifier in block["id"]}
    assert ours & received
    assert received - ours


def test_a_foreign_dbc_names_what_comes_in(run: Path, tmp_path) -> None:
    assert command(import_command, run / "can.blf", tmp_path / "back", "--dbc", DBC)[0] == PASS
    record, ours = read(tmp_path / "back"), read(run)
    name = next(one for one in record.signals if one.endswith("left_height"))
    np.testing.assert_allclose(record.series(name)[1] * 1e-3, ours.series("left.height")[1], rtol=1e-9)


def test_a_table_at_one_rate_comes_back_as_it_was(run: Path, tmp_path) -> None:
    target = tmp_path / "table.csv"
    assert command(export_command, run, target, "--rate", 50, "--signal", "left.height")[0] == PASS
    table = pd.read_csv(target)
    expected = read(run).frame(["left.height"], 50.0)["left.height"].to_numpy()
    np.testing.assert_allclose(table["left.height [mm]"] * 1e-3, expected, rtol=1e-8)
    assert command(import_command, target, tmp_path / "back")[0] == PASS
    times, values = read(tmp_path / "back").series("left.height")
    there = ~np.isnan(expected)
    np.testing.assert_allclose(values, expected[there], rtol=1e-8)
    np.testing.assert_allclose(np.diff(times), 0.02)


@pytest.mark.mdf
def test_every_sample_event_and_circumstance_comes_back_from_mdf(run: Path, tmp_path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="MDF needs the extra mdf: `make test-mdf`")
    target = tmp_path / "record.mf4"
    assert command(export_command, run, target)[0] == PASS
    with asammdf.MDF(target) as mdf:
        height = mdf.get("left.height")
        assert height.unit == "mm"
        np.testing.assert_allclose(height.samples * 1e-3, read(run).series("left.height")[1])
        state = read(run).signals["rig.state"].names[int(read(run).series("rig.state")[1][0])]
        assert mdf.get("rig.state").samples[0] == state.encode()
    assert command(import_command, target, tmp_path / "back")[0] == PASS
    same_samples(run, tmp_path / "back")
    one, other = read(run), read(tmp_path / "back")
    assert one.events == other.events
    assert {**one.meta, "imported": other.meta["imported"]} == other.meta


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", "time_s,left.hight [mm]\n0,1\n", "'left.hight [mm]' is not a signal of the bench"),
        (
            "a.csv",
            "time_s,left.height [N]\n0,1\n",
            "is in N, which left.height cannot have; write left.height [mm]",
        ),
        ("a.csv", "time_s,left.height [furlong]\n0,1\n", '"furlong" is not a known unit'),
        ("a.csv", "time_s,left.bellows_pressure [bar(a)]\n0,1\n", "is a gauge pressure"),
        (
            "a.csv",
            "time_s,left.height [mm]\n0,1\n1,much\n",
            'left.height [mm]: "much" in line 3 is not a number; correct the cell, or give the right --table del',
        ),
        ("a.csv", "time_s,left.height [mm]\n1,1\n0,2\n", "a.csv: the clock falls"),
        ("a.csv", "t,left.height [mm]\n0,1\n", "has no column time_s"),
        ("a.csv", "time_s,left.height [mm]\n0,1\n,2\n1,3\n", "line 3 has a value, but no time"),
        ("a.csv", "time_s,left.height [mm]\n0,1\ninf,2\n", "line 3 has a value, but no time"),
        ("a.blf", "rubbish", "is not a BLF file"),
        ("a.log", "", "holds no data frame"),
        ("a.xls", "", "ssconvert a.xls a.csv"),
    ],
)
def test_a_failed_import_is_reported_and_leaves_no_files(
    tmp_path, name: str, content: str, said: str
) -> None:
    (tmp_path / name).write_text(content)
    status, text = command(import_command, tmp_path / name, tmp_path / "back")
    assert status == MISUSE
    assert said in text
    assert not (tmp_path / "back").exists()


def test_unknown_frames_are_refused_without_their_dbc(run: Path, tmp_path) -> None:
    from bench_protocol.frames import frame

    write_frames([frame(0x7F0, b"12345678", 10**9)], tmp_path / "theirs.blf")
    status, text = command(import_command, tmp_path / "theirs.blf", tmp_path / "back")
    assert status == MISUSE
    assert "for the messages of another rig, give its DBC with --dbc" in text
    assert not (tmp_path / "back").exists()


def test_existing_files_are_not_overwritten(run: Path) -> None:
    status, text = command(import_command, run / "can.blf", run)
    assert status == MISUSE
    assert "is not empty" in text


def test_frames_that_a_run_kept_are_not_written_over_by_their_own_export(run: Path) -> None:
    before = (run / "can.blf").read_bytes()
    status, text = command(export_command, run, run / "can.blf")
    assert status == MISUSE
    assert "is not overwritten" in text
    assert (run / "can.blf").read_bytes() == before


def test_every_end_of_writing_is_reported_and_no_queue_grows(tmp_path, monkeypatch) -> None:
    class Broken:
        def on_message_received(self, message: can.Message) -> None:
            raise ValueError("no such channel")

    class Port:
        def subscribe(self, hear) -> None:
            self.hear = hear

        def close(self) -> None:
            pass

    monkeypatch.setattr(can_log, "_open_writer", lambda path: Broken())
    port = Port()
    log = CanLog(port, tmp_path / "can.blf")
    for _ in range(3):
        port.hear(np.zeros(2, FRAME))
    with refuses(CanLogError, "channel"):
        log.close()
    assert log._waiting.empty()


def test_checksums_equal_sha256sum_and_show_changes(run: Path, tmp_path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    subprocess.run(["sha256sum", "--quiet", "-c", SUMS], cwd=copy, check=True, timeout=30)
    assert broken_files(copy) == []
    (copy / "result.json").write_text("{}")
    (copy / "meta.json").unlink()
    assert broken_files(copy) == ["meta.json is missing", "result.json was changed"]


def test_frames_of_any_kind_survive_every_format(tmp_path) -> None:
    from bench_protocol.frames import frame, join

    rng = np.random.default_rng(4)
    frames = join(
        frame(
            int(rng.integers(0x800 if not extended else 1 << 29)),
            rng.bytes(length),
            10**9 * k,
            extended=extended,
        )
        for k, (length, extended) in enumerate([(0, False), (8, False), (3, True), (8, True)])
    )
    for ending in ("blf", "asc", "log", "trc"):
        path = tmp_path / f"bus.{ending}"
        write_frames([frames], path)
        back = join(read_frames(path))
        for field in ("id", "extended", "length", "data"):
            np.testing.assert_array_equal(back[field], frames[field], err_msg=f"{ending}: {field}")
    with refuses(CanLogError):
        write_frames([frames], tmp_path / "bus.xyz")
