"""What holds of logs of every form: packing, charsets, clocks; and whatever is changed in one, no value is another."""

import gzip
import random
from collections.abc import Callable

import pytest

from drivers.can_files.frames import CanLogError
from tests.astb.test_import_of_logs import TESTED as OF_IMPORT
from tests.drivers.can_files import test_logs
from tests.drivers.can_files.log_forms import (
    ASC_HEAD,
    asc,
    asc_lines,
    by_python_can,
    candump,
    candump_lines,
    recording,
    trc,
    trc_lines,
)
from tests.drivers.can_files.log_reading import TESTED, form, read, refused, replace_channel, same
from tools.generate.readers_page import table


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
        assert any("sorted by time" in one for one in account.taken)
    swapped = recording()
    swapped[3], swapped[6] = swapped[6]._replace(time=swapped[3].time + 1_000_000), swapped[3]
    refused(tmp_path, "a.log", candump(sorted(swapped[:3]) + swapped[3:4] + swapped[6:7]), "clock goes back")


def test_pause_and_time_of_day_are_reported(tmp_path) -> None:
    frames = [one._replace(time=one.time + 5_000_000_000 * (k >= 20)) for k, one in enumerate(recording())]
    _, account = read(tmp_path, "a.log", candump(frames))
    assert account.taken[0].startswith("there are no frames for 5.00")
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
def test_a_changed_recording_is_equal_or_refused_or_its_loss_is_reported(tmp_path, seed: int) -> None:
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
    if delta:  # it is invisible in time stamps that count
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
    assert test_logs.__doc__  # it is loaded, and has named its rows
    assert {one.name for one in table("logs").forms} == TESTED | OF_IMPORT
