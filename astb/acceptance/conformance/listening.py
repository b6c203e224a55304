"""Tests of the messages that a rig sends: identifiers, rates, gaps, counters and plausible content."""

from typing import Final

import numpy as np

from astb.acceptance.conformance.raw_access import RawAccess
from astb.acceptance.conformance.report import Notebook
from bench_protocol.can_codec import Decoder, Tally
from bench_protocol.frames import Block
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms, s

#: Time to listen to the bus.
LISTEN: Final = 3 * s
#: Time to measure the offset of the time stamps.
SETTLE: Final = 0.5 * s
#: Permitted relative error of a rate.
RATE_BAND: Final = 0.02
#: A reading is stale after three periods, 100 ms at least: every gap must be clearly shorter.
GAP_PERIODS: Final = 3.0
GAP_FLOOR: Final = 50 * ms


def listen(access: RawAccess) -> list[Notebook]:
    """Record the frames on a bus without a commander, and return the findings."""
    access.wait(SETTLE)
    before = access.listener.frames().size
    steps = access.listener.steps
    access.wait(LISTEN)
    frames = access.listener.frames()[before:]
    times = _times(frames)
    steps = access.listener.steps - steps
    times.note("jumps of the time stamps", steps == 0, f"{steps}", "0")
    return [times, _protection(frames), _contents(access, frames)]


def _times(frames: Block) -> Notebook:
    book = Notebook("frames on CAN")
    for message in TABLE.messages:
        if not message.from_rig or not message.rate:
            continue
        times = frames["time"][(frames["id"] == message.identifier) & (frames["extended"] == 0)]
        right = f"{message.rate:g} Hz"
        if times.size < 2:
            book.note(
                f"{message.name}, rate", False, f"{times.size} frames in {LISTEN:g} s", right, value=0.0
            )
            continue
        gaps = np.diff(times) / NS
        rate, longest = 1.0 / gaps.mean(), float(gaps.max())
        good = abs(rate - message.rate) <= RATE_BAND * message.rate
        apart = RATE_BAND * message.rate
        book.note(f"{message.name}, rate", good, f"{rate:.1f} Hz", right, value=rate, apart=apart)
        limit = max(GAP_FLOOR, GAP_PERIODS / message.rate)
        book.note(
            f"{message.name}, longest gap",
            longest <= limit,
            f"{longest / ms:.1f} ms",
            f"at most {limit / ms:.0f} ms",
            value=longest,
            apart=limit,
        )
    return book


def _protection(frames: Block) -> Notebook:
    book = Notebook("frame counters")
    decoder = Decoder(TABLE, from_rig=True)
    decoder.decode(frames)
    for what, kind in {
        "lost frames": Tally.LOST,
        "repeated frames": Tally.REPEATED,
        "frames out of sequence": Tally.OUT_OF_SEQUENCE,
        "frames with a wrong length": Tally.MALFORMED,
    }.items():
        count = int(decoder.tally[kind])
        book.note(what, count == 0, f"{count}", "0")
    return book


def _contents(access: RawAccess, frames: Block) -> Notebook:
    book = Notebook("values in frames")
    samples = Decoder(TABLE, from_rig=True).decode(frames)
    outside, silent = [], []
    carried = {place.signal for m in TABLE.messages if m.from_rig and m.rate for place in m.fields}
    for name in sorted(carried, key=TABLE.index.__getitem__):
        signal = TABLE[name]
        values = samples.values[samples.signals == TABLE.index[name]]
        good = values[np.isfinite(values)]
        if not good.size:
            silent.append(name)
        elif good.min() < signal.low or good.max() > signal.high:
            outside.append(f"{name} = {signal.show(float(good[np.abs(good).argmax()]))}")
    book.note("values out of their range", not outside, ", ".join(outside) or "none", "none")
    measurements = [name for name in silent if TABLE[name].group is not None]
    book.note(
        "measurements that are not available", not measurements, ", ".join(measurements) or "none", "none"
    )
    map_hash = access.listener.latest("rig.map_hash")
    found = "not reported" if np.isnan(map_hash) else f"{int(map_hash):#010x}"
    right = f"{TABLE.map_hash:#010x}"
    book.note("hash of the signal map", found == right, found, right)
    return book
