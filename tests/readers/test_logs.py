"""Logs of CAN frames in every form that people have: equal, or left out and counted, or refused; never different."""

import gzip
import random
from collections.abc import Callable, Sequence
from pathlib import Path

import can
import numpy as np
import pytest

from astb.readers_page import table
from bench_protocol.account import Account
from drivers.can_files.frames import CanLogError
from drivers.can_files.reading import read_log
from tests.readers.log_forms import (
    ASC_HEAD,
    START,
    Sample,
    asc,
    asc_lines,
    blf_object,
    by_python_can,
    candump,
    candump_lines,
    recording,
    trc,
    trc_lines,
    with_objects,
)
from tests.readers.test_import_of_logs import TESTED as OF_IMPORT

TESTED: set[str] = set()


def form(name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Say which row of the table a test is of."""
    TESTED.add(name)
    return lambda test: test


def read(folder: Path, name: str, content: str | bytes, **keys: object) -> tuple[list[Sample], Account]:
    path, account = folder / name, Account()
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    found = [
        Sample(time, int(kind.channel.removeprefix("can")), kind.identifier, kind.extended, kind.fd, data)
        for time, kind, data in read_log(path, account, **keys)  # type: ignore[arg-type]
    ]
    return found, account


def same(found: Sequence[Sample], expected: Sequence[Sample], within: int = 0) -> None:
    """Equal frames at equal intervals: where a log begins is not the same in all forms."""
    assert [one[1:] for one in found] == [one[1:] for one in expected]
    if found:
        times = np.array([one.time for one in found]) - found[0].time
        others = np.array([one.time for one in expected]) - expected[0].time
        np.testing.assert_allclose(times, others, atol=within, rtol=0)


def refused(folder: Path, name: str, content: str | bytes, said: str, **keys: object) -> None:
    with pytest.raises(CanLogError, match=said):
        read(folder, name, content, **keys)


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


def replace_channel(one: Sample, channel: int) -> Sample:
    return one._replace(channel=channel)


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
def test_names_without_it(tmp_path) -> None:
    refused(
        tmp_path,
        "a.asc",
        asc(recording(), name="Heights"),
        r"names in the place of identifiers \(Heights in line 7\)",
    )
    lines = asc(recording()).splitlines()
    lines += [
        asc_lines(recording(1), name=name)[0].replace("0.000000", "9.000000") for name in ("Heights", "ADD")
    ]
    refused(tmp_path, "a.asc", "\n".join(lines), r"Heights in line .*, and ADD in line 4[0-9] may be either")


BESIDE_ASC = {
    "error frame(s)": ["1  ErrorFrame", "CANFD   1 Rx ErrorFrame  0 0", "2  ErrorFrame\tECC: 10100010"],
    "overload frame(s)": ["1  OverloadFrame"],
    "remote frame(s)": ["1  100             Rx   r", "1  100             Tx   r 8"],
    "request(s) to send, which are no frames yet": ["1  100             TxRq d 1 00"],
    "event(s) that are no CAN frames": [
        "1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%",
        "CAN 1 Status:chip status error active",
        "J1939TP FEE3p 6 0 0 - Rx d 4 A0 0F A6 60",
        "LIN 1 2D Tx 2 00 01 checksum = 98",
        "log trigger event",
    ],
    "line(s) of an unknown form": [
        "1  100 Rx   d 8 00 01",
        "1  800 Rx   d 1 00",
        "1  100 Rx   d 1 0G",
        "2 2 2 2",
    ],
}


@form("asc beside")
@pytest.mark.parametrize("delta", [False, True])
@pytest.mark.parametrize("what", BESIDE_ASC)
def test_what_stands_beside_the_frames_of_asc_is_counted(tmp_path, what: str, delta: bool) -> None:
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
    """All whole lines come in; what is left of the last one never does, unless nothing of it is lacking."""
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
        tmp_path, "a.asc", "\n".join(asc_lines(frames)), "does not say whether its numbers are hexadecimal"
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
    refused(tmp_path, "a.log", twice, "in line 41 the time stamps begin anew")
    lines = candump_lines(recording(), "d")
    lines[20] = "(000.001) can1 what is this"
    refused(tmp_path, "a.log", "\n".join(lines) + "\n", "all later time stamps count from it")


@form("candump beside")
@pytest.mark.parametrize("shown", [False, True])
@pytest.mark.parametrize("stamps", "aAd")
def test_what_stands_beside_the_frames_of_a_candump_is_counted(tmp_path, stamps: str, shown: bool) -> None:
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
    assert account.counts == {"error frame(s)": 1, "remote frame(s)": 1, "line(s) of an unknown form": 2}


@form("candump no stamps")
@form("log of others")
def test_logs_that_are_none_of_these(tmp_path) -> None:
    lines = [line.split(")")[1] for line in candump_lines(recording(), shown=True)]
    refused(tmp_path, "a.log", "\n".join(lines), "line 1: .* has no time stamp; candump -L")
    busmaster = "***BUSMASTER Ver 3.2.2***\n***PROTOCOL CAN***\n10:00:00:0000 Rx 1 0x100 s 8 F4 01 0C FE 00 00 00 00\n"
    refused(tmp_path, "a.log", busmaster, r"is a log of BUSMASTER, not of \.log; known are \.blf, \.asc")
    refused(tmp_path, "a.log", asc(recording()), r"is in the form of ASC, not of \.log")
    refused(tmp_path, "a.asc", candump(recording()), "is not a file of CAN frames as its ending says: line 1")
    refused(tmp_path, "a.log", "", "holds no data frame")
    refused(tmp_path, "a.log", "(1.0) can0 20000004#0004000000000000\n", r"no data frame \(1 error frame\)")
    refused(tmp_path, "a.xyz", "", r"ends in \.xyz; files of CAN frames end in \.blf")


@form("trc versions")
@form("trc fd")
@pytest.mark.parametrize("version", ["1.0", "1.1", "1.2", "1.3", "2.0", "2.1"])
def test_trc(tmp_path, version: str) -> None:
    frames = recording(fd=version >= "2")
    found, account = read(tmp_path, "a.trc", trc(frames, version))
    same(found, frames)
    assert account.counts == {}


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
def test_what_stands_beside_the_frames_of_a_trc_is_counted(tmp_path, version: str, extra, counts) -> None:
    lines = trc(recording(), version).splitlines()
    found, account = read(tmp_path, "a.trc", "\n".join([*lines[:20], *extra, *lines[20:]]) + "\n")
    same(found, recording())
    assert counts == tuple(
        account.counts.get(what, 0)
        for what in ("error frame(s)", "remote frame(s)", "event(s) that are no CAN frames")
    )


@form("trc unknown")
def test_traces_that_nobody_knows(tmp_path) -> None:
    text = trc(recording(), "2.1")
    refused(tmp_path, "a.trc", text.replace("=2.1", "=3.0"), "is of version 3.0; read are 1.0, 1.1")
    refused(tmp_path, "a.trc", text.replace(",R,", ",q,"), "column 'q' in line 3: .* is none that is known")
    refused(tmp_path, "a.trc", text.replace("$COLUMNS", "COLUMNS"), "version 2.1 needs a line")
    refused(tmp_path, "a.trc", text + text, "a second log begins in line 4[0-9]")


@form("blf beside")
def test_what_stands_beside_the_frames_of_a_blf_is_counted(tmp_path) -> None:
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


@form("blf damaged")
def test_what_is_no_blf(tmp_path) -> None:
    content = by_python_can(recording(), ".blf")
    refused(tmp_path, "a.blf", b"rubbish", "does not begin with LOGG")
    refused(tmp_path, "a.blf", content[:20], "is damaged behind frame 0|holds no data frame")
    place = content.index(b"LOBJ") + 16
    changed = content[:place] + b"\x07" + content[place + 1 :]
    refused(tmp_path, "a.blf", changed, "is packed by a method 7")


@form("packed")
@form("charsets")
@pytest.mark.parametrize("name", ["a.asc", "a.log", "a.trc"])
def test_every_form_may_be_packed_and_in_any_charset(tmp_path, name: str) -> None:
    text = {"a.asc": asc(recording()), "a.log": candump(recording()), "a.trc": trc(recording(), "2.1")}[name]
    for charset in ("utf-8-sig", "utf-16", "latin-1"):
        for end in ("\n", "\r\n", "\r"):
            same(read(tmp_path, name, text.replace("\n", end).encode(charset))[0], recording())
    packed = gzip.compress(text.encode())
    same(read(tmp_path, f"{name}.gz", packed)[0], recording())
    found, account = read(tmp_path, f"{name}.gz", packed[: len(packed) - 30])
    same(found, recording()[: len(found)])
    assert account.counts
    same(read(tmp_path, name, text + "\0" * 512)[0], recording())


@form("packed")
def test_a_packed_blf(tmp_path) -> None:
    content = gzip.compress(by_python_can(recording(), ".blf"))
    same(read(tmp_path, "a.blf.gz", content)[0], recording(), within=1000)


@form("clock back")
@pytest.mark.parametrize(
    ("name", "step"),
    [
        *((name, step) for name in ("a.asc", "a.log", "a.trc") for step in (-1.0, -0.05, 90_000.0)),
        ("a.blf", -1.0),
        ("a.blf", -0.05),
    ],
)
def test_a_clock_that_goes_back_or_leaps_is_refused_with_its_place(tmp_path, name: str, step: float) -> None:
    first, second = (
        recording(),
        [one._replace(time=one.time + round((step + 2.0) * 1e9)) for one in recording()],
    )
    first = [one._replace(time=one.time + 2_000_000_000 - recording()[-1].time) for one in first]
    frames = first + second
    content: dict[str, Callable[[], str | bytes]] = {
        "a.asc": lambda: asc(frames),
        "a.log": lambda: candump(frames),
        "a.trc": lambda: trc(frames, "2.1"),
        "a.blf": lambda: by_python_can(first, ".blf"),
    }
    if name == "a.blf":  # python-can's writer puts them in order: two files are put together
        with_two = by_python_can(first, ".blf"), by_python_can(second, ".blf")
        begin = with_two[1].index(b"LOBJ")
        refused(tmp_path, name, with_two[0] + with_two[1][begin:], "the clock goes back")
        return
    refused(
        tmp_path,
        name,
        content[name](),
        "the clock goes back from" if step < 0 else "the clock leaps by 1 day",
    )


@form("disorder")
def test_frames_a_little_out_of_order_are_put_in_order(tmp_path) -> None:
    frames = sorted(recording() + [replace_channel(one, 2)._replace(identifier=0x7) for one in recording()])
    frames = [one._replace(time=one.time + 200_000 * (one.channel == 2)) for one in frames]
    ordered = sorted(frames, key=lambda one: one.time)
    late = sorted(frames, key=lambda one: one.time + 3_000_000 * (one.channel == 2))
    for name, text in (("a.asc", asc(late)), ("a.log", candump(late))):
        found, account = read(tmp_path, name, text)
        same(found, ordered)
        assert any("put in the order" in one for one in account.taken)
    swapped = recording()
    swapped[3], swapped[6] = swapped[6]._replace(time=swapped[3].time + 1_000_000), swapped[3]
    refused(tmp_path, "a.log", candump(sorted(swapped[:3]) + swapped[3:4] + swapped[6:7]), "clock goes back")


def test_a_pause_and_the_time_of_the_day_are_told(tmp_path) -> None:
    frames = [one._replace(time=one.time + 5_000_000_000 * (k >= 20)) for k, one in enumerate(recording())]
    _, account = read(tmp_path, "a.log", candump(frames))
    assert account.taken[0].startswith("nothing came for 5.00")
    assert account.taken[0].endswith("before line 21")
    assert account.taken[1] == "the times are of the day; the record begins 2023-11-14 22:13:20 UTC"


CHANGES: dict[str, Callable[[random.Random, list[str]], list[str]]] = {
    "ends": lambda rng, lines: [line + "\r" for line in lines],
    "empty": lambda rng, lines: [one for line in lines for one in ([line, "  "] if rng.random() < 0.1 else [line])],
    "unknown": lambda rng, lines: with_line(rng, lines, "what is this"),
    "comment": lambda rng, lines: with_line(rng, lines, "// a comment"),
    "cut": lambda rng, lines: [*lines[:-1], lines[-1][: rng.randrange(len(lines[-1]) + 1)]],
    "twice": lambda rng, lines: lines + lines,
    "back": lambda rng, lines: lines[len(lines) // 2 :] + lines[: len(lines) // 2],
    "lost": lambda rng, lines: [line for line in lines if rng.random() > 0.05],
    "spaces": lambda rng, lines: [line + "  " for line in lines],
}  # fmt: skip


def with_line(rng: random.Random, lines: list[str], line: str) -> list[str]:
    place = rng.randrange(len(lines) + 1)
    return [*lines[:place], line, *lines[place:]]


@pytest.mark.parametrize("seed", range(60))
def test_a_recording_in_any_form_and_changed_is_equal_or_refused_or_its_loss_is_told(
    tmp_path, seed: int
) -> None:
    """Never different: each frame that comes in is one of the recording, in its order, at its time."""
    rng = random.Random(seed)
    frames = recording(40, fd=rng.random() < 0.3)
    ending = rng.choice(["asc", "log", "trc"])
    delta = rng.random() < 0.4
    if ending == "asc":
        base = rng.choice(["hex", "dec"])
        head = ASC_HEAD.format(base=base, stamps="relative" if delta else "absolute").splitlines()
        lines = asc_lines(frames, base, delta, tail=rng.choice(["", "  Length = 1 BitCount = 2 ID"]))
    elif ending == "log":
        shown = rng.random() < 0.5
        head, lines = (
            [],
            candump_lines(frames, "d" if delta else rng.choice("aAz"), shown, rng.choice(["", "x", "a"])),
        )
    else:
        delta, version = False, rng.choice(["2.0", "2.1"])
        head, lines = trc([], version).splitlines(), trc_lines(frames, version)
    changes = rng.sample(sorted(CHANGES), rng.randrange(3))
    if delta:  # of stamps that count nobody could see it
        changes = [one for one in changes if one not in ("lost", "twice", "back")]
    for change in changes:
        lines = CHANGES[change](rng, lines)
    text = "\n".join([*head, *lines]) + ("" if "cut" in changes else "\n")
    content = text.encode(rng.choice(["utf-8", "utf-8-sig", "utf-16"]))
    packed = rng.random() < 0.2
    try:
        found, account = read(
            tmp_path, f"a.{ending}{'.gz' * packed}", gzip.compress(content) if packed else content
        )
    except CanLogError as error:
        assert set(changes) & {"twice", "back", "unknown", "comment"}, error
        return
    if "lost" not in changes and len(found) == len(frames):
        same(found, frames)
        return
    place = {one[1:]: one.time for one in frames}
    assert len(found) <= len(frames)
    shift = found[0].time - place[found[0][1:]]
    assert [one.time - place[one[1:]] for one in found] == [shift] * len(found)
    assert "lost" in changes or account.counts


def test_every_row_of_the_table_has_its_test() -> None:
    assert {one.name for one in table("logs").forms} == TESTED | OF_IMPORT
