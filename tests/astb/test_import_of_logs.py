"""Logs become records: the message of a frame, its channel and sender; omitted frames are counted."""

from pathlib import Path

import can
import numpy as np
import pytest
from click.testing import CliRunner

from astb.commands.exchange import import_command
from astb.exit_codes import MISUSE, PASS
from astb.frames_import import columns_of_frames
from bench_records.record import read
from bench_records.result import read_result
from diagnosis.contracts import Dataset, DiagnosisError
from diagnosis.systems.mapping import read_mapped
from tests.drivers.can_files.log_forms import START, Sample, asc, by_python_can, candump, gvret
from tests.refusals import refuses
from tools.generate.readers_page import table

TESTED = {
    "j1939 packets",
    "beyond",
    "channels",
    "one channel",
    "mdf frames",
    "mdf beside",
    "mdf without frames",
    "map",
}
HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: PLC BENCH\n'
LEFT, RIGHT = (
    f' SG_ {name} : {bit}|16@1- (0.01,0) [0|0] "mm" B\n' for name, bit in (("Left", 0), ("Right", 16))
)
HEIGHTS = f"BO_ 256 Heights: 8 PLC\n{LEFT}{RIGHT}"
FORCES = 'BO_ 257 Forces: 8 PLC\n SG_ Left : 0|16@1- (1,0) [0|0] "N" B\n'
J1939 = (
    HEAD
    + f'BO_ {0x18FF21FE | 1 << 31} State: 8 PLC\n SG_ Height : 0|16@1+ (0.05,-1600) [-1600|1612.75] "mm" B\n'
    'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'
)


@pytest.fixture
def came(tmp_path):
    """Import a log; return the exit code, the output, and the path of the record."""

    def come(name: str, content: str | bytes, dbc: str, *options: str) -> tuple[int, str, Path]:
        (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
        (tmp_path / "rig.dbc").write_text(dbc)
        out = tmp_path / f"run{len(list(tmp_path.glob('run*')))}"
        done = CliRunner().invoke(
            import_command, [str(tmp_path / name), str(out), "--dbc", str(tmp_path / "rig.dbc"), *options]
        )
        return done.exit_code, done.output, out

    return come


def heights(
    count: int, identifier: int = 0x100, channel: int = 1, sign: int = 1, fd: bool = False
) -> list[Sample]:
    """Frames with k mm on the left, and less than nothing on the right."""
    return [
        Sample(
            k * 20_000_000 + channel * 1_000_000,
            channel,
            identifier,
            identifier > 0x7FF,
            fd,
            (sign * k * 100 % 65536).to_bytes(2, "little")
            + (-sign * k * 100 % 65536).to_bytes(2, "little")
            + bytes(4),
        )
        for k in range(count)
    ]


def in_order(*parts: list[Sample]) -> list[Sample]:
    return sorted(one for part in parts for one in part)


@pytest.mark.parametrize("name", ["a.asc", "a.log", "a.blf"])
def test_a_channel_is_selected_or_the_channels_are_listed(came, name: str) -> None:
    frames = in_order(heights(30), heights(30, channel=2, sign=-1))
    content = {"a.asc": asc, "a.log": candump, "a.blf": lambda all_: by_python_can(all_, ".blf")}[name](
        frames
    )
    channels = ("can1", "can2") if name == "a.log" else ("1", "2")
    status, text, out = came(name, content, HEAD + HEIGHTS)
    assert status == MISUSE and not out.exists()
    assert f"0x100 (Heights) is on the channels {channels[0]} and {channels[1]}" in text
    assert f"such as --channel {channels[0]}" in text
    for channel, sign in zip(channels, (1, -1), strict=True):
        status, text, out = came(name, content, HEAD + HEIGHTS, "--channel", channel)
        assert status == PASS
        assert "left out: 30 frames on other channels" in text
        np.testing.assert_allclose(read(out).series("Heights.Left")[1], sign * np.arange(30.0))
    status, text, _ = came(name, content, HEAD + HEIGHTS, "--channel", "7")
    assert status == MISUSE and f"has the channels {channels[0]} and {channels[1]}" in text


def test_different_messages_on_different_channels_are_one_record(came) -> None:
    frames = in_order(heights(30), heights(30, 0x101, channel=2))
    status, _, out = came("a.asc", asc(frames), HEAD + HEIGHTS + FORCES)
    assert status == PASS
    assert read(out).series("Forces.Left")[1].size == 30


def test_the_bench_s_own_messages_on_two_channels_are_refused_as_well(tmp_path) -> None:
    from bench_protocol.table import TABLE

    one = next(message for message in TABLE.messages if message.from_rig)
    log = tmp_path / "a.log"
    log.write_text(candump(in_order(heights(9, one.identifier), heights(9, one.identifier, channel=2))))
    done = CliRunner().invoke(import_command, [str(log), str(tmp_path / "run")])
    assert done.exit_code == MISUSE
    assert "is on the channels can1 and can2" in done.output


@pytest.mark.parametrize("name", ["a.asc", "a.log", "a.blf"])
def test_frames_of_can_fd_are_decoded_and_the_rest_stays_counted_in_the_record(came, name: str) -> None:
    frames = in_order(heights(30), heights(30, 0x101, fd=True), heights(5, 0x333))
    content = {"a.asc": asc, "a.log": candump, "a.blf": lambda all_: by_python_can(all_, ".blf")}[name](
        frames
    )
    status, text, out = came(name, content, HEAD + HEIGHTS + FORCES)
    assert status == PASS
    np.testing.assert_allclose(read(out).series("Forces.Left")[1], 100.0 * np.arange(30))
    told = "5 frames that rig.dbc does not describe (the first: identifier 0x333)"
    assert f"left out: {told}" in text
    assert read(out).meta["reading"]["left_out"] == {"frame(s) that rig.dbc does not describe": 5}
    assert f"left out: {told}" in read_result(out).warnings
    assert told in (out / "report.html").read_text()


def test_only_what_comes_of_a_dbc_is_judged(came) -> None:
    faults = (
        'BO_ 512 Faults: 8 PLC\n SG_ Code : 0|8@1+ (1,0) [0|255] "" B\n SG_ Pump : 0|1@1+ (1,0) [0|1] "" B\n'
    )
    status, _, out = came("a.log", candump(heights(30)), HEAD + HEIGHTS + faults)
    assert status == PASS
    np.testing.assert_allclose(read(out).series("Heights.Left")[1], np.arange(30.0))
    twice = HEAD + HEIGHTS + HEIGHTS.replace("Heights", "Others").replace("0.01", "0.02") + FORCES
    status, text, _ = came("a.log", candump(heights(30)), twice)
    assert status == MISUSE and "describes 0x100 twice, as Heights and Others" in text
    assert came("a.log", candump(heights(30, 0x101)), twice)[0] == PASS


def test_values_beyond_the_range_of_the_dbc_are_reported(came) -> None:
    within = HEIGHTS.replace("[0|0]", "[-300|5]", 1)
    status, text, out = came("a.log", candump(heights(30)), HEAD + within)
    assert status == PASS
    assert "Heights.Left: 24 values are beyond the range that rig.dbc gives, -300 to 5 mm" in " ".join(
        text.split()
    )
    np.testing.assert_allclose(read(out).series("Heights.Left")[1], np.arange(30.0))


def test_one_name_of_two_messages_gives_two_series(came) -> None:
    dbc = HEAD + HEIGHTS + HEIGHTS.replace("256", "258")
    status, _, out = came("a.log", candump(in_order(heights(20), heights(20, 0x102, sign=-1))), dbc)
    assert status == PASS
    for name, sign in (("Heights_0x100.Left", 1), ("Heights_0x102.Left", -1)):
        np.testing.assert_allclose(read(out).series(name)[1], sign * np.arange(20.0))


def state(source: int, raw: int, count: int = 10, priority: int = 6) -> list[Sample]:
    data = raw.to_bytes(2, "little") + b"\xff" * 6
    identifier = priority << 26 | 0xFF2100 | source
    return [Sample(k * 10_000_000 + source * 1000, 1, identifier, True, False, data) for k in range(count)]


def test_j1939_by_group_with_what_is_not_available_missing(came) -> None:
    frames = in_order(state(0x27, 32000 + 200), state(0x28, 0xFFFF, priority=3))
    status, text, out = came("a.log", candump(frames), J1939)
    assert status == PASS and "left out: 10 J1939 values that are not available" in text
    record = read(out)
    np.testing.assert_allclose(record.series("State@27.Height")[1], 10.0)
    assert np.isnan(record.series("State@28.Height")[1]).all()
    status, _, out = came(
        "a.log", candump(in_order(state(0x27, 32000), state(0x27, 32000, 3, priority=3))), J1939
    )
    assert status == PASS
    np.testing.assert_allclose(read(out).series("State.Height")[1], 0.0, atol=1e-9)


WIDE = (
    'BO_ {number} Wide: 20 PLC\n SG_ First : 0|16@1+ (0.05,-1600) [-1600|1612.75] "mm" B\n'
    ' SG_ Last : 144|16@1+ (1,0) [0|64255] "N" B\n'
)


def packets(group: int, data: bytes, source: int, to: int = 0xFF, start: int = 0) -> list[Sample]:
    """A message as SAE J1939-21 cuts it up: announced (BAM, or RTS to one), then seven bytes a packet."""
    count = -(-len(data) // 7)
    said = [
        32 if to == 0xFF else 16,
        *len(data).to_bytes(2, "little"),
        count,
        0xFF,
        *group.to_bytes(3, "little"),
    ]
    rows = [(0x1CEC0000, bytes(said))]
    rows += [(0x1CEB0000, bytes([k + 1]) + data[7 * k : 7 * k + 7].ljust(7, b"\xff")) for k in range(count)]
    return [
        Sample(start + k * 50_000_000 + source * 1000, 1, base | to << 8 | source, True, False, part)
        for k, (base, part) in enumerate(rows)
    ]


def wide(k: int) -> bytes:
    return (32000 + 20 * k).to_bytes(2, "little") + bytes(16) + (7 * k).to_bytes(2, "little")


@pytest.mark.parametrize(("group", "to"), [(0xFF22, 0xFF), (0xFF22, 0x31), (0xEF00, 0x31)])
def test_j1939_messages_of_several_packets_are_put_together(came, group: int, to: int) -> None:
    number = (0x18 << 24 | (group | (to if group < 0xF000 else 0)) << 8 | 0xFE) | 1 << 31
    dbc = J1939.replace("BA_DEF_", WIDE.format(number=number) + "BA_DEF_", 1)
    one = [packets(group, wide(k), 0x27, to, k * 10**9) for k in range(5)]
    other = packets(group, wide(90), 0x28, to, 2 * 10**9)  # in between, from another
    lost = packets(group, wide(50), 0x27, to, 6 * 10**9)
    del lost[2]
    frames = in_order(*one, other, lost, state(0x27, 32000))
    status, text, out = came("a.log", candump(frames), dbc)
    assert status == PASS
    assert "6 J1939 messages of several packets (TP) were reassembled" in text
    assert f"1 incomplete J1939 message of several packets (TP) (group {group:#x})" in text
    record = read(out)
    for signal, right in (("First", np.arange(5.0)), ("Last", 7.0 * np.arange(5))):
        np.testing.assert_allclose(record.series(f"Wide@27.{signal}")[1], right, atol=1e-9)
    np.testing.assert_allclose(np.diff(record.series("Wide@27.Last")[0]), 1.0)
    np.testing.assert_allclose(record.series("Wide@28.First")[1], 90.0)
    np.testing.assert_allclose(record.series("State.Height")[1], 0.0, atol=1e-9)


def test_packets_asked_for_again_aborted_or_never_announced(came) -> None:
    dbc = J1939.replace("BA_DEF_", WIDE.format(number=0x18FF22FE | 1 << 31) + "BA_DEF_", 1)
    again = packets(0xFF22, wide(3), 0x27, 0x31)
    wrong = again[2]._replace(time=again[2].time - 1_000_000, data=again[2].data[:1] + bytes(7))
    answers = [
        again[0]._replace(
            time=again[0].time + 1_000, identifier=0x1CEC2731, data=bytes([17, 3, 1, 255, 255, 0x22, 0xFF, 0])
        )
    ]
    ended = packets(0xFF22, wide(4), 0x27, 0x31, 10**9)[:3]
    ended.append(
        ended[-1]._replace(
            time=ended[-1].time + 1_000, identifier=0x1CEC2731, data=bytes([255] * 5 + [0x22, 0xFF, 0])
        )
    )
    stray = packets(0xFF22, wide(5), 0x29, start=2 * 10**9)[1:]
    frames = in_order(again, [wrong], answers, ended, stray)
    status, text, out = came("a.log", candump(frames), dbc)
    assert status == PASS
    np.testing.assert_allclose(read(out).series("Wide.Last")[1], [21.0])
    np.testing.assert_allclose(read(out).series("Wide.First")[1], [3.0], atol=1e-9)
    assert "1 incomplete J1939 message of several packets (TP)" in text
    assert "3 J1939 packets (TP) without an announcement" in text


def mdf_of_signals(folder: Path) -> bytes:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as mdf:
        mdf.append([Signal(np.arange(9.0), np.arange(9.0), name="F", unit="N")])
        mdf.save(folder / "signals.mf4", overwrite=True)
    return (folder / "signals.mf4").read_bytes()


@pytest.mark.mdf
def test_frames_in_mdf_come_in_as_those_of_a_log(came, tmp_path) -> None:
    pytest.importorskip("asammdf", reason="MDF needs the extra mdf: `make test-mdf`")
    error = can.Message(timestamp=START / 1e9 + 0.1, is_error_frame=True, channel=0)
    frames = in_order(heights(30), heights(30, 0x101, fd=True), heights(9, 0x18FF2127))
    content = by_python_can(frames, ".mf4", [error])
    status, text, out = came("a.mf4", content, HEAD + HEIGHTS + FORCES)
    assert status == PASS
    assert "left out: 1 error frame, 9 frames that rig.dbc does not describe" in text
    record = read(out)
    np.testing.assert_allclose(record.series("Heights.Left")[1], np.arange(30.0))
    np.testing.assert_allclose(record.series("Forces.Left")[1], 100.0 * np.arange(30))
    np.testing.assert_allclose(np.diff(record.series("Forces.Left")[0]), 0.02, atol=1e-6)
    two = by_python_can(in_order(heights(30), heights(30, channel=2)), ".mf4")
    status, text, _ = came("a.mf4", two, HEAD + HEIGHTS)
    assert status == MISUSE and "0x100 (Heights) is on the channels" in text
    status, text, _ = came("a.mf4", mdf_of_signals(tmp_path), HEAD + HEIGHTS)
    assert status == MISUSE and "holds no data frame (1 group without CAN frames" in text
    status, text, _ = came("a.mf4", b"rubbish", HEAD + HEIGHTS)
    assert status == MISUSE and "is not an MDF file: it does not begin with MDF" in text


MAP = """
system = "piston"
[frames]
dbc = "rig.dbc"
{frames}
[columns]
displacement = {{ column = "{column}", unit = "mm" }}
pressure = {{ column = "Gas.P", unit = "bar", reading = "gauge" }}
force = {{ column = "Gas.F", unit = "N", noise = "1 N" }}
[settings]
bore = "25 mm"
stroke_from = "-3 mm"
stroke_to = "100 mm"
"""
GAS = 'BO_ 257 Gas: 8 PLC\n SG_ P : 0|16@1- (0.01,0) [0|0] "bar" B\n SG_ F : 16|16@1- (1,0) [0|0] "N" B\n'


@pytest.mark.parametrize("name", ["a.asc", "a.log", "a.blf"])
def test_a_map_reads_logs_by_the_names_of_their_dbc(tmp_path, name: str) -> None:
    frames = in_order(
        *(heights(60, identifier, channel) for channel in (1, 2) for identifier in (0x100, 0x101))
    )
    frames.insert(0, heights(1, 0x333)[0])
    content = {"a.asc": asc, "a.log": candump, "a.blf": lambda all_: by_python_can(all_, ".blf")}[name](
        frames
    )
    (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    (tmp_path / "rig.dbc").write_text(HEAD + HEIGHTS + GAS)
    channel = "can1" if name == "a.log" else "1"

    def mapped(frames: str = f'channel = "{channel}"', column: str = "Heights.Left") -> Dataset:
        (tmp_path / "map.toml").write_text(MAP.format(frames=frames, column=column))
        return read_mapped([tmp_path / name], tmp_path / "map.toml", None, columns_of_frames)[1]

    dataset = mapped()
    (run,) = dataset.runs
    np.testing.assert_allclose(np.diff(run.experiment.time), 0.02, rtol=1e-4)
    np.testing.assert_allclose(
        run.outputs[:, 0], 100.0 * np.arange(len(run.outputs)) * -1 + run.outputs[0, 0], atol=1
    )
    assert any("120 frames on other channels" in one and name in one for one in dataset.readings)
    with pytest.raises(DiagnosisError, match=f"such as frames.channel = {channel}"):
        mapped("")
    with refuses(DiagnosisError, "displacement.column 'Hight' Gas.F Gas.P Heights.Left"):
        mapped(column="Hight")


def test_a_key_that_a_file_has_no_use_for_is_refused(tmp_path) -> None:
    (tmp_path / "a.csv").write_text("time_s,left.height [mm]\n0,1\n")
    for option, value in (("--channel", "1"), ("--stamps", "delta")):
        done = CliRunner().invoke(
            import_command, [str(tmp_path / "a.csv"), str(tmp_path / "run"), option, value]
        )
        assert done.exit_code == MISUSE and f"{option} is only for files of CAN frames" in done.output


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("a.log", ["--charset", "cp1250"], "--charset is only for a DBC; give --dbc"),
        ("a.asc", ["--stamps", "delta"], "--stamps is only for logs of candump"),
        ("a.log", ["--table", "decimal=,"], "--table is only for tables and MDF files, not for the frames"),
        ("a.csv", ["--table", "group=1"], "--table group=1 is only for an MDF file"),
        ("a.csv", ["--table", "raw=true"], "--table raw=True is only for an MDF file"),
    ],
)
def test_a_key_without_a_file_is_refused(tmp_path, name: str, options: list[str], said: str) -> None:
    table = "time_s,left.height [mm]\n0,1\n1,2\n"
    content = {"a.log": candump(heights(9)), "a.asc": asc(heights(9)), "a.csv": table}[name]
    (tmp_path / name).write_text(content)
    done = CliRunner().invoke(import_command, [str(tmp_path / name), str(tmp_path / "run"), *options])
    assert done.exit_code == MISUSE and said in done.output, done.output
    assert not (tmp_path / "run").exists()


def test_frames_as_csv_are_named(tmp_path) -> None:
    (tmp_path / "a.csv").write_bytes(by_python_can(heights(9), ".csv"))
    done = CliRunner().invoke(import_command, [str(tmp_path / "a.csv"), str(tmp_path / "run")])
    assert done.exit_code == MISUSE
    assert "of python-can as CSV, not a table of samples; use one of .blf" in " ".join(done.output.split())
    (tmp_path / "map.toml").write_text(MAP.format(frames="", column="Heights.Left"))
    (tmp_path / "rig.dbc").write_text(HEAD + HEIGHTS + GAS)
    with refuses(DiagnosisError, "table"):
        read_mapped([tmp_path / "a.csv"], tmp_path / "map.toml", None, columns_of_frames)


def test_a_log_of_savvycan_is_read_as_frames(came) -> None:
    code, _, out = came("run.csv", gvret(heights(200)), HEAD + HEIGHTS)
    assert code == PASS
    assert np.isfinite(read(out).series("Heights.Left")[1]).all()


def test_the_rows_of_channels_are_in_the_table() -> None:
    assert {one.name for one in table("logs").forms} >= TESTED


def test_raw_values_that_the_dbc_names_are_nan_in_the_record_and_counted(came) -> None:
    """65535 "SNA" is neither 6253.5 mm nor a state: the signal stays a number with its unit."""
    dbc = HEAD + HEIGHTS + 'VAL_ 256 Left 100 "SNA" ;\n'
    code, said, out = came("run.asc", asc(heights(200)), dbc)
    assert code == PASS
    assert "1 value of Heights.Left that the DBC names 'SNA'" in said
    record = read(out)
    left = record.signals["Heights.Left"]
    assert (left.unit, left.names) == ("mm", {})
    _, values = record.series("Heights.Left")
    assert int(np.isnan(values).sum()) == 1
