"""Logs of CAN frames in every form that people have: equal, or left out and counted, or refused."""

import random
import struct

import can
import numpy as np
import pytest

from tests.drivers.can_files.log_forms import (
    START,
    asc,
    asc_lines,
    blf_object,
    by_python_can,
    candump,
    candump_lines,
    gvret,
    recording,
    trc,
    with_objects,
)
from tests.drivers.can_files.log_reading import form, read, refused, replace_channel, same


@form("asc plain")
@form("candump log")
@form("blf plain")
@pytest.mark.parametrize("ending", [".asc", ".log", ".blf", ".trc"])
def test_what_python_can_writes(tmp_path, ending: str) -> None:
    frames = recording(fd=ending != ".trc")
    found, account = read(tmp_path, f"a{ending}", by_python_can(frames, ending))
    if ending == ".log":  # the channel 0 of python-can is can0 there
        found = [replace_channel(one, one.channel + 1) for one in found]
    same(found, frames, within=1000)
    assert account.counts == {}


@form("blf plain")
def test_channels_of_blf_are_those_that_canoe_shows(tmp_path) -> None:
    frames = [replace_channel(one, 1 + k % 2) for k, one in enumerate(recording())]
    found, _ = read(tmp_path, "a.blf", by_python_can(frames, ".blf"))
    assert {one.channel for one in found} == {1, 2}
    same(found, frames, within=1000)


@form("asc relative")
@form("asc decimal")
@form("asc fd")
@form("asc tails")
@pytest.mark.parametrize("delta", [False, True])
@pytest.mark.parametrize("base", ["hex", "dec"])
@pytest.mark.parametrize(
    "tail", ["", "  Length = 230000 BitCount = 118", "  Length = 230000 BitCount = 118 ID"]
)
def test_asc(tmp_path, base: str, delta: bool, tail: str) -> None:
    for fd in (False, True):
        found, account = read(tmp_path, "a.asc", asc(recording(fd=fd), base, delta, tail=tail))
        same(found, recording(fd=fd))
        assert account.counts == {}
        assert bool(account.taken) == delta


@form("asc fd")
def test_a_message_that_is_named_in_a_line_of_can_fd(tmp_path) -> None:
    frames = [one for one in recording(fd=True) if one.fd]
    same(read(tmp_path, "a.asc", asc(frames, name="SpringState"))[0], frames)


@form("asc other words")
def test_asc_of_other_people(tmp_path) -> None:
    head = (
        "date Mo Mär 9 10:00:00 2026\nbase hex timestamps absolute\nno internal events logged\n// a comment\n"
    )
    text = head + "\n".join(asc_lines(recording())) + "\nEnd Triggerblock\n"
    same(read(tmp_path, "a.asc", text.replace("\n", "\r\n").encode("cp1252"))[0], recording())


@form("asc symbolic")
def test_names_with_their_number(tmp_path) -> None:
    for name in ("SpringState", "ADD"):
        found, _ = read(tmp_path, "a.asc", asc(recording(), name=name, tail="  Length = 1 BitCount = 2 ID"))
        same(found, recording())


@form("asc names only")
@form("asc names or numbers")
def test_ambiguous_names_are_refused(tmp_path) -> None:
    refused(
        tmp_path,
        "a.asc",
        asc(recording(), name="Heights"),
        r"names instead of identifiers \(Heights in line 7\)",
    )
    lines = asc(recording()).splitlines()
    lines += [
        asc_lines(recording(1), name=name)[0].replace("0.000000", "9.000000") for name in ("Heights", "ADD")
    ]
    refused(
        tmp_path,
        "a.asc",
        "\n".join(lines),
        r"Heights in line .*, and ADD in line 4[0-9] may be names or numbers",
    )


BESIDE_ASC = {
    "error frame(s)": ["1  ErrorFrame", "CANFD   1 Rx ErrorFrame  0 0", "2  ErrorFrame\tECC: 10100010"],
    "overload frame(s)": ["1  OverloadFrame"],
    "remote frame(s)": ["1  100             Rx   r", "1  100             Tx   r 8"],
    "request(s) to send, which are not frames": ["1  100             TxRq d 1 00"],
    "event(s) other than CAN frames": [
        "1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%",
        "CAN 1 Status:chip status error active",
        "J1939TP FEE3p 6 0 0 - Rx d 4 A0 0F A6 60",
        "LIN 1 2D Tx 2 00 01 checksum = 98",
        "log trigger event",
    ],
    "line(s) of unknown form": [
        "1  100 Rx   d 8 00 01",
        "1  800 Rx   d 1 00",
        "1  100 Rx   d 1 0G",
        "2 2 2 2",
    ],
}


@form("asc beside")
@pytest.mark.parametrize("delta", [False, True])
@pytest.mark.parametrize("what", BESIDE_ASC)
def test_other_lines_of_asc_are_counted(tmp_path, what: str, delta: bool) -> None:
    lines = asc(recording(), delta=delta).splitlines()
    for k, extra in enumerate(BESIDE_ASC[what]):
        stamp = "0.000000" if delta else lines[10 + 2 * k].split()[0]
        lines.insert(11 + 2 * k, f"   {stamp} {extra}")
    found, account = read(tmp_path, "a.asc", "\n".join(lines) + "\n")
    same(found, recording())
    assert account.counts == {what: len(BESIDE_ASC[what])}


@form("asc cut")
@form("candump cut")
@form("trc cut")
@pytest.mark.parametrize("name", ["hex.asc", "dec.asc", "log.log", "shown.log", "1.1.trc", "2.1.trc"])
def test_a_log_may_break_off_anywhere(tmp_path, name: str) -> None:
    """All whole lines are read; a cut last line is read only if it is complete."""
    frames = recording(12)
    kind, ending = name.rsplit(".", 1)
    text = {
        "asc": lambda: asc(frames, kind),
        "log": lambda: candump(frames, shown=kind == "shown"),
        "trc": lambda: trc(frames, kind),
    }[ending]()
    lines = text.splitlines(keepends=True)
    ends = np.cumsum([len(line) for line in lines])[-len(frames) - (ending == "asc") :][: len(frames)]
    for cut in range(int(ends[-4]), len(text)):
        found, account = read(tmp_path, f"a.{ending}", text[:cut])
        same(found, frames[: len(found)])
        whole = int((ends <= cut).sum())
        assert whole <= len(found) <= min(whole + 1, len(frames))
        rest = text[:cut].rsplit("\n", 1)[1].strip()
        assert account.counts or not rest or len(found) > whole or "End TriggerBlock".startswith(rest)


@form("asc no base")
@form("asc two logs")
@form("asc relative gap")
def test_asc_of_which_something_would_be_guessed(tmp_path) -> None:
    frames = recording()
    refused(
        tmp_path, "a.asc", "\n".join(asc_lines(frames)), "does not state whether its numbers are hexadecimal"
    )
    refused(tmp_path, "a.asc", asc(frames) + asc(frames), "a second log begins in line 4[0-9]")
    relative = asc(frames, delta=True)
    refused(tmp_path, "a.asc", relative + "Begin Triggerblock Mon\n", "a second block begins in line 4[0-9]")
    lines = relative.splitlines()
    lines.insert(20, "  -0.5 garbled")
    refused(tmp_path, "a.asc", "\n".join(lines) + "\n", "line 21: .*all later ones count from it")


@form("candump shown")
@form("candump dates")
@form("candump delta")
@form("candump zero")
@pytest.mark.parametrize("stamps", ["a", "A", "d", "z"])
@pytest.mark.parametrize("extra", [None, "", "x", "a", "S", "c", "xac"])
def test_candump(tmp_path, stamps: str, extra: str | None) -> None:
    for fd in (False, True):
        text = candump(recording(fd=fd), stamps, extra is not None, extra or "")
        found, account = read(tmp_path, "a.log", text)
        same(found, recording(fd=fd))
        assert account.counts == {}
        assert any("count from line to line" in one for one in account.taken) == (stamps == "d")
        assert any("taken as UTC" in one for one in account.taken) == (stamps == "A")


@form("candump delta")
def test_stamps_that_count_are_known_by_falling_or_by_standing(tmp_path) -> None:
    even = [one._replace(time=k * 20_000_000) for k, one in enumerate(recording())]
    same(read(tmp_path, "a.log", candump(even, "d"))[0], even)
    text = candump(even, "d").replace("(000.", "(0.")  # as a script may write them
    same(read(tmp_path, "a.log", text)[0], even)
    few = recording(3)
    same(read(tmp_path, "a.log", candump(few, "d"), stamps="delta")[0], few)
    same(read(tmp_path, "a.log", candump(few, "z"), stamps="absolute")[0], few)


@form("candump few")
def test_stamps_that_may_count_or_not(tmp_path) -> None:
    rising = [one._replace(time=k * k * 1_000_000) for k, one in enumerate(recording(6))]
    for stamps in "dz":
        refused(
            tmp_path,
            "a.log",
            candump(rising, stamps),
            "6 lines are too few .*--stamps absolute or --stamps delta",
        )
    twice = candump(recording(), "z") + candump(recording(), "z")
    refused(tmp_path, "a.log", twice, "in line 41 the time stamps go back")
    lines = candump_lines(recording(), "d")
    lines[20] = "(000.001) can1 what is this"
    refused(tmp_path, "a.log", "\n".join(lines) + "\n", "all later time stamps count from it")


@form("candump beside")
@pytest.mark.parametrize("shown", [False, True])
@pytest.mark.parametrize("stamps", "aAd")
def test_other_lines_of_a_candump_are_counted(tmp_path, stamps: str, shown: bool) -> None:
    lines = candump_lines(recording(), stamps, shown)
    times = [line.split(")")[0] + ")" for line in lines]
    stand = "(000.000000)" if stamps == "d" else None
    extra = (
        ["can1  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME", "can1  123   [0]  remote request"]
        if shown
        else ["can1 20000004#0004000000000000", "can1 123#R8"]
    )
    for k, text in enumerate(extra):
        lines.insert(10 + k, f"{stand or times[9]} {text}")
    lines.insert(20, "\tcontroller-problem{tx-error-warning}")
    lines.insert(25, "DROPCOUNT: dropped 5 CAN frames on 'can0' socket (total drops 5)")
    found, account = read(tmp_path, "a.log", "\n".join(lines) + "\n")
    same(found, recording())
    assert account.counts == {"error frame(s)": 1, "remote frame(s)": 1, "line(s) of unknown form": 2}


@form("candump no stamps")
@form("log of others")
def test_logs_that_are_none_of_these(tmp_path) -> None:
    lines = [line.split(")")[1] for line in candump_lines(recording(), shown=True)]
    refused(tmp_path, "a.log", "\n".join(lines), "line 1: .* has no time stamp; record with candump -L")
    busmaster = "***BUSMASTER Ver 3.2.2***\n***PROTOCOL CAN***\n10:00:00:0000 Rx 1 0x100 s 8 F4 01 0C FE 00 00 00 00\n"
    refused(tmp_path, "a.log", busmaster, r"is a log of BUSMASTER, not of \.log; use one of \.blf, \.asc")
    refused(tmp_path, "a.log", asc(recording()), r"is in the form of ASC, not of \.log")
    refused(tmp_path, "a.asc", candump(recording()), "is not a file of CAN frames as its ending says: line 1")
    refused(tmp_path, "a.log", "", "holds no data frame")
    refused(tmp_path, "a.log", "(1.0) can0 20000004#0004000000000000\n", r"no data frame \(1 error frame\)")
    refused(tmp_path, "a.xyz", "", r"ends in \.xyz; use a file of CAN frames with one of the endings \.blf")


@form("trc versions")
@form("trc fd")
@pytest.mark.parametrize("version", ["1.0", "1.1", "1.2", "1.3", "2.0", "2.1"])
def test_trc(tmp_path, version: str) -> None:
    frames = recording(fd=version >= "2")
    found, account = read(tmp_path, "a.trc", trc(frames, version))
    same(found, frames)
    assert account.counts == {}


@form("gvret")
@pytest.mark.parametrize("directions", [True, False])
def test_gvret(tmp_path, directions: bool) -> None:
    """By its head, not by its ending; other content is counted."""
    text = gvret(recording(), directions)
    found, account = read(tmp_path, "a.csv", text)
    same(found, recording(), within=1000)
    assert account.counts == {}
    width = text.partition("\n")[0].count(",") + 1
    strange = [
        "1,20000000,true,Rx,0,0",
        "1,100,perhaps,Rx,0,1,01",
        "x,100,false,Rx,0,1,01",
        "1,100,false,Rx,0,9,01",
    ]
    rows = [row if width == 14 else row.replace("Rx,", "") for row in (*strange, "1,100,false,Rx,0,2,0G,01")]
    found, account = read(tmp_path, "a.csv", text + "\n".join(rows) + "\n")
    same(found, recording(), within=1000)
    assert sum(account.counts.values()) == len(rows)
    refused(tmp_path, "a.csv", "Time Stamp,ID,Extended,Dir\n1,100,false,Rx\n", "no column Bus, LEN, D1")


@form("trc beside")
@pytest.mark.parametrize(
    ("version", "extra", "counts"),
    [
        ("1.0", ["9) 0 FFFFFFFF 4 00 00 00 08", "9) 0 0100 3 RTR"], (1, 1, 0)),
        ("1.1", ["9) 0.0 Error 0008 4 00 00 00 00", "9) 0.0 Rx 0100 3 RTR", "9) 0.0 Warng FFFFFFFF 4 8"], (1, 1, 1)),
        ("1.3", ["9) 0.0 1  Error  0008 -  4  00 00 00 00", "9) 0.0 1  Rx  0100 -  3  RTR"], (1, 1, 0)),
        ("2.0", ["9 0.0 ER     Rx  04 00 00 00", "9 0.0 RR 0100 Rx 3", "9 0.0 ST    Rx 00 00"], (1, 1, 1)),
        ("2.1", ["9 0.0 ER 1   - Rx - 5 04 00", "9 0.0 RR 1 0100 Rx - 3", "9 0.0 EV 1 User-defined event"], (1, 1, 1)),
    ],
)  # fmt: skip
def test_other_lines_of_a_trc_are_counted(tmp_path, version: str, extra, counts) -> None:
    lines = trc(recording(), version).splitlines()
    found, account = read(tmp_path, "a.trc", "\n".join([*lines[:20], *extra, *lines[20:]]) + "\n")
    same(found, recording())
    assert counts == tuple(
        account.counts.get(what, 0)
        for what in ("error frame(s)", "remote frame(s)", "event(s) other than CAN frames")
    )


@form("trc unknown")
def test_unknown_traces(tmp_path) -> None:
    text = trc(recording(), "2.1")
    refused(tmp_path, "a.trc", text.replace("=2.1", "=3.0"), "is of version 3.0; use one of 1.0, 1.1")
    refused(tmp_path, "a.trc", text.replace(",R,", ",q,"), "column 'q' in line 3: .* is unknown")
    refused(tmp_path, "a.trc", text.replace("$COLUMNS", "COLUMNS"), "because version 2.1 needs it")
    refused(tmp_path, "a.trc", text + text, "a second log begins in line 4[0-9]")


@form("blf beside")
def test_other_objects_of_a_blf_are_counted(tmp_path) -> None:
    at = (START + 100_000_000) / 1e9
    extra = [
        can.Message(timestamp=at, is_error_frame=True),
        can.Message(timestamp=at, is_remote_frame=True, dlc=3),
    ]
    content = by_python_can(recording(), ".blf", extra)
    others = blf_object(65, b"text") + blf_object(4, bytes(16)) + blf_object(2, bytes(8))
    found, account = read(tmp_path, "a.blf", with_objects(content, others))
    same(found, recording(), within=1000)
    assert account.counts == {
        "error frame(s)": 2,
        "remote frame(s)": 1,
        "object(s) of other kinds than CAN frames": 2,
    }


@form("blf cut")
def test_a_blf_may_break_off_anywhere(tmp_path) -> None:
    rng = random.Random(3)
    frames = [one._replace(data=rng.randbytes(8)) for one in recording(9000)]
    content = by_python_can(frames, ".blf")
    for cut in (len(content) - 1, len(content) - 40, len(content) * 3 // 4, len(content) // 2):
        found, account = read(tmp_path, "a.blf", content[:cut])
        same(found, frames[: len(found)], within=1000)
        assert 0 < len(found) <= len(frames)
        assert account.left_out == "1 end of a file that breaks off" or len(found) == len(frames)


@form("blf start")
def test_a_blf_with_frames_before_its_start_and_a_second_of_1000_ms(tmp_path) -> None:
    from can.io import blf

    frames = recording()
    content = bytearray(by_python_can(frames, ".blf"))
    head = list(blf.FILE_HEADER_STRUCT.unpack(content[: blf.FILE_HEADER_STRUCT.size]))
    start = head[14:22]
    head[21] = 1000  # the milliseconds of the start
    content[: blf.FILE_HEADER_STRUCT.size] = blf.FILE_HEADER_STRUCT.pack(*head)
    late, account = read(tmp_path, "a.blf", bytes(content))
    early, _ = read(tmp_path, "a.blf", by_python_can(frames, ".blf"))
    assert late[0].time - early[0].time == pytest.approx((1000 - start[7]) * 10**6, abs=1000)
    assert "UTC" not in str(account.taken)
    message = struct.pack("<HBBL8s", 1, 0, 8, 0x100, bytes(range(8)))
    before = bytearray(blf_object(1, message))
    before[24:32] = struct.pack("<q", -5_000_000)
    found, _ = read(
        tmp_path, "a.blf", with_objects(by_python_can([], ".blf"), bytes(before) + blf_object(1, message))
    )
    assert found[1].time - found[0].time == pytest.approx(5_000_000, abs=1000)


@form("asc before")
@form("asc dlc")
@form("asc lengths")
def test_stamps_below_zero_and_lengths_in_asc(tmp_path) -> None:
    head = "base hex  timestamps absolute\n"
    found, account = read(tmp_path, "a.asc", head + "-0.002000 1 100 Rx d 1 07\n0.001000 1 100 Rx d 1 08\n")
    assert [one.time for one in found] == [-2_000_000, 1_000_000] and account.counts == {}
    data = " ".join(["07"] * 64)
    for code, length in (("f", 64), ("15", 64), ("10", 16)):
        found, account = read(tmp_path, "a.asc", f"{head}0.001 CANFD 1 Rx 100 1 0 {code} {length} {data}\n")
        assert [len(one.data) for one in found] == [length] and account.counts == {}
    refused(
        tmp_path, "a.asc", f"{head}0.001 CANFD 1 Rx 100 1 0 40 15 {data}\n", "DLC 40 before data length 15"
    )


@form("blf damaged")
def test_what_is_no_blf(tmp_path) -> None:
    content = by_python_can(recording(), ".blf")
    refused(tmp_path, "a.blf", b"rubbish", "does not begin with LOGG")
    refused(tmp_path, "a.blf", content[:20], "is damaged after frame 0|holds no data frame")
    place = content.index(b"LOBJ") + 16
    changed = content[:place] + b"\x07" + content[place + 1 :]
    refused(tmp_path, "a.blf", changed, "is compressed by the method 7")
