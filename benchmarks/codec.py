"""Frames and lines: the compiled CAN codec beside cantools, the socketcand parser beside python-can's."""

from collections.abc import Callable
from typing import Final

import numpy as np

from astb.dbc import dbc
from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.frames import FRAME, join
from bench_protocol.socketcand import Parser, frame_bytes, iterate
from bench_protocol.table import FAST_RATE, TABLE
from benchmarks.measure import Effort, Section, compare, cpu, interleaved

ROUNDS: Final = 200
#: Frames that arrive in one packet.
PACKET: Final = 12


def run(effort: Effort) -> Section:
    """Measure encoding, decoding, formatting and parsing, per frame."""
    try:
        import cantools
    except ImportError:
        return Section("Codecs, per frame", (), ("Skipped: cantools is not installed.",))
    import can
    from can.interfaces.socketcand.socketcand import (
        convert_ascii_message_to_can_message,
        convert_can_message_to_ascii_message,
    )

    names = [message.name for message in TABLE.messages if message.from_rig and message.rate == FAST_RATE]
    values = np.array([0.5 * (signal.low + signal.high) for signal in TABLE.signals])
    encoder, decoder = Encoder(TABLE), Decoder(TABLE, from_rig=True)
    rows = encoder.rows(names)
    count = len(names)
    database = cantools.database.load_string(dbc(), "dbc")
    messages = [database.get_message_by_name(name) for name in names]
    blocks = [encoder.encode(values, rows, 0) for _ in range(ROUNDS)]
    payloads = [data for _, _, _, data in iterate(blocks[0])]
    decoded = [m.decode(data, decode_choices=False) for m, data in zip(messages, payloads, strict=True)]

    packet = np.zeros(PACKET, FRAME)
    packet[:] = np.resize(join(blocks)[:count], PACKET)
    lines = frame_bytes(packet)
    each = [f"{line}>" for line in lines.decode().split(">")[:-1]]
    frames = [can.Message(arbitration_id=0x123, is_extended_id=False, data=data) for data in payloads]
    parser = Parser()

    def subject(action: Callable[[], object], items: int) -> Callable[[], float]:
        return lambda: cpu(action, items)

    found = interleaved(
        effort.repetitions,
        {
            "encode": subject(lambda: [encoder.encode(values, rows, 0) for _ in blocks], ROUNDS * count),
            "cantools encode": subject(
                lambda: [m.encode(v, scaling=True) for m, v in zip(messages, decoded, strict=True)], count
            ),
            "decode": subject(lambda: [decoder.decode(block) for block in blocks], ROUNDS * count),
            "cantools decode": subject(
                lambda: [m.decode(d, decode_choices=False) for m, d in zip(messages, payloads, strict=True)],
                count,
            ),
            "format": subject(lambda: [frame_bytes(packet) for _ in blocks], ROUNDS * PACKET),
            "stock format": subject(
                lambda: [convert_can_message_to_ascii_message(frame) for frame in frames], len(frames)
            ),
            "parse": subject(lambda: [parser.feed(lines) for _ in blocks], ROUNDS * PACKET),
            "stock parse": subject(
                lambda: [convert_ascii_message_to_can_message(line) for line in each], PACKET
            ),
        },
    )
    pairs = (
        ("encode a frame", "encode", "cantools", "cantools encode"),
        ("decode a frame", "decode", "cantools", "cantools decode"),
        ("format a line of the hub", "format", "python-can", "stock format"),
        ("parse a line of the hub", "parse", "python-can", "stock parse"),
    )
    speed = 1.0 / float(np.median(found["parse"]))
    notes = (
        f"The {count} messages that the rig sends 200 times a second, in one call, counters included; lines in packets "
        f"of {PACKET}, which is {speed / 1000:.0f} 000 frames parsed in a second. Processor time of one thread.",
    )
    return Section(
        "Codecs, per frame",
        [compare(what, found[ours], other, found[theirs]) for what, ours, other, theirs in pairs],
        notes,
    )
