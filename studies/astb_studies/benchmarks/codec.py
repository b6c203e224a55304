"""Time per frame: the compiled CAN codec compared with cantools, the socketcand parser with that of python-can."""

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Final

import numpy as np

from astb_studies.benchmarks.measure import Effort, Section, compare, cpu, interleaved
from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.frames import FRAME, Block, join
from bench_protocol.rates import FAST_RATE
from bench_protocol.socketcand import Parser, frame_bytes, iterate
from bench_protocol.table import TABLE
from tools.generate.dbc import dbc

ROUNDS: Final = 200
#: Frames that arrive in one packet.
PACKET: Final = 12


#: Operation, our function, the library of the control, and its function.
PAIRS: Final = (
    ("encode a frame", "encode", "cantools", "cantools encode"),
    ("decode a frame", "decode", "cantools", "cantools decode"),
    ("format a line of the hub", "format", "python-can", "stock format"),
    ("parse a line of the hub", "parse", "python-can", "stock parse"),
)

Subjects = dict[str, Callable[[], float]]


def run(effort: Effort) -> Section:
    """Measure encoding, decoding, formatting and parsing, per frame."""
    title = "Codecs, per frame"
    if find_spec("cantools") is None:
        return Section(title, (), ("Skipped: cantools is not installed.",))
    names = [message.name for message in TABLE.messages if message.from_rig and message.rate == FAST_RATE]
    values = np.array([0.5 * (signal.low + signal.high) for signal in TABLE.signals])
    encoder = Encoder(TABLE)
    rows = encoder.rows(names)
    blocks = [encoder.encode(values, rows, 0) for _ in range(ROUNDS)]
    found = interleaved(
        effort.repetitions,
        _frames(lambda: encoder.encode(values, rows, 0), blocks, names) | _lines(blocks, len(names)),
    )
    speed = 1.0 / float(np.median(found["parse"]))
    notes = (
        f"The {len(names)} messages that the rig sends 200 times a second, in one call, counters included; lines "
        f"in packets of {PACKET}: {speed / 1000:.0f} 000 frames are parsed in a second. Processor time of one thread.",
    )
    return Section(
        title,
        [compare(what, found[ours], other, found[theirs]) for what, ours, other, theirs in PAIRS],
        notes,
    )


def _per_item(action: Callable[[], object], items: int) -> Callable[[], float]:
    return lambda: cpu(action, items)


def _frames(encode: Callable[[], Block], blocks: Sequence[Block], names: Sequence[str]) -> Subjects:
    """Measure encoding and decoding of the messages ``names``; every block has one frame of each."""
    import cantools

    database = cantools.database.load_string(dbc(), "dbc")
    messages = [database.get_message_by_name(name) for name in names]
    payloads = [data for _, _, _, data in iterate(blocks[0])]
    decoded = [m.decode(data, decode_choices=False) for m, data in zip(messages, payloads, strict=True)]
    decoder = Decoder(TABLE, from_rig=True)
    count = len(names)
    return {
        "encode": _per_item(lambda: [encode() for _ in blocks], ROUNDS * count),
        "cantools encode": _per_item(
            lambda: [m.encode(v, scaling=True) for m, v in zip(messages, decoded, strict=True)], count
        ),
        "decode": _per_item(lambda: [decoder.decode(block) for block in blocks], ROUNDS * count),
        "cantools decode": _per_item(
            lambda: [m.decode(d, decode_choices=False) for m, d in zip(messages, payloads, strict=True)],
            count,
        ),
    }


def _lines(blocks: Sequence[Block], count: int) -> Subjects:
    """Measure formatting and parsing of the lines of the hub; the first ``count`` frames are used repeatedly."""
    import can
    from can.interfaces.socketcand.socketcand import (
        convert_ascii_message_to_can_message,
        convert_can_message_to_ascii_message,
    )

    packet = np.zeros(PACKET, FRAME)
    packet[:] = np.resize(join(blocks)[:count], PACKET)
    lines = frame_bytes(packet)
    each = [f"{line}>" for line in lines.decode().split(">")[:-1]]
    payloads = [data for _, _, _, data in iterate(blocks[0])]
    frames = [can.Message(arbitration_id=0x123, is_extended_id=False, data=data) for data in payloads]
    parser = Parser()
    return {
        "format": _per_item(lambda: [frame_bytes(packet) for _ in blocks], ROUNDS * PACKET),
        "stock format": _per_item(
            lambda: [convert_can_message_to_ascii_message(frame) for frame in frames], len(frames)
        ),
        "parse": _per_item(lambda: [parser.feed(lines) for _ in blocks], ROUNDS * PACKET),
        "stock parse": _per_item(
            lambda: [convert_ascii_message_to_can_message(line) for line in each], PACKET
        ),
    }
