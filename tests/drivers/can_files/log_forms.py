"""One recording in every form that people's logs have."""

import io
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import can

START = 1_700_000_000 * 10**9


class Sample(NamedTuple):
    """A frame as it is to come in: time (ns), channel from 1, identifier, extended, FD, data."""

    time: int
    channel: int
    identifier: int
    extended: bool
    fd: bool
    data: bytes


def recording(count: int = 40, fd: bool = False, channel: int = 1) -> list[Sample]:
    """A few messages in turn with uneven intervals of whole microseconds."""
    frames, time = [], 0
    for k in range(count):
        time += (2_000, 8_130, 7_870)[k % 3] * 1000 * bool(k)
        identifier, extended = ((0x100, False), (0x18FF2127, True), (0x2AF, False))[k % 3]
        size = (8, 8, 3)[k % 3] if not (fd and k % 3 == 1) else 24
        data = bytes((17 * k + 3 * j) % 256 for j in range(size))
        frames.append(Sample(time, channel, identifier, extended, fd and k % 3 == 1, data))
    return frames


def message(one: Sample) -> can.Message:
    return can.Message(
        timestamp=(START + one.time) / 1e9,
        arbitration_id=one.identifier,
        is_extended_id=one.extended,
        data=one.data,
        channel=one.channel - 1,
        is_fd=one.fd,
    )


def by_python_can(frames: Sequence[Sample], ending: str, extra: Sequence[can.Message] = ()) -> bytes:
    """What python-can's own writer makes of the frames, and of others in the order of their times."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{ending}"
        writer = can.Logger(path)
        for one in sorted([*map(message, frames), *extra], key=lambda one: one.timestamp):
            writer.on_message_received(one)
        writer.stop()
        return path.read_bytes()


ASC_HEAD = "date Mon Mar 9 10:00:00.000 am 2026\nbase {base}  timestamps {stamps}\ninternal events logged\n"
ASC_BLOCK = (
    "// version 8.2.0\nBegin Triggerblock Mon Mar 9 10:00:00.000 am 2026\n   0.000000 Start of measurement\n"
)


def stamps_of(frames: Sequence[Sample], delta: bool) -> list[float]:
    times = [one.time / 1e9 for one in frames]
    return [after - before for before, after in zip([0.0, *times], times, strict=False)] if delta else times


def asc_lines(
    frames: Sequence[Sample], base: str = "hex", delta: bool = False, tail: str = "", name: str = ""
) -> list[str]:
    lines = []
    for one, stamp in zip(frames, stamps_of(frames, delta), strict=True):
        number = f"{one.identifier:X}" if base == "hex" else str(one.identifier)
        identifier = name or number + "x" * one.extended
        data = " ".join(f"{byte:02X}" if base == "hex" else str(byte) for byte in one.data)
        if one.fd:
            size = can.util.len2dlc(len(one.data))
            lines.append(
                f"   {stamp:.6f} CANFD   {one.channel} Rx   {number + 'x' * one.extended:>8}  {name:>32} 1 0 {size:x} "
                f"{len(one.data):2} {data}   128015  130   303000 0 0 0 0 0"
            )
        else:
            own = f"  ID = {one.identifier}{'x' * one.extended}" if "ID" in tail else ""
            tails = tail.replace("ID", "") + own
            lines.append(
                f"   {stamp:.6f} {one.channel}  {identifier:<15} Rx   d {len(one.data)} {data}{tails}"
            )
    return lines


def asc(frames: Sequence[Sample], base: str = "hex", delta: bool = False, **keys: str) -> str:
    head = ASC_HEAD.format(base=base, stamps="relative" if delta else "absolute") + ASC_BLOCK
    return head + "\n".join([*asc_lines(frames, base, delta, **keys), "End TriggerBlock\n"])


def candump_lines(
    frames: Sequence[Sample], stamps: str = "a", shown: bool = False, extra: str = ""
) -> list[str]:
    """Lines of candump with ``-t`` a, A, d or z; ``shown`` for people, with the options in ``extra``."""
    lines = []
    for one, stamp in zip(frames, stamps_of(frames, stamps == "d"), strict=True):
        if stamps == "a":
            time = f"{START // 10**9 + one.time // 10**9}.{one.time % 10**9 // 1000:06d}"
        elif stamps == "A":
            day = datetime.fromtimestamp(START // 10**9, UTC) + timedelta(microseconds=one.time // 1000)
            time = f"{day:%Y-%m-%d %H:%M:%S.%f}"
        else:
            time = f"{stamp:010.6f}"
        number = f"{one.identifier:08X}" if one.extended else f"{one.identifier:03X}"
        if not shown:
            lines.append(
                f"({time}) can{one.channel} {number}{'##1' if one.fd else '#'}{one.data.hex().upper()}"
            )
            continue
        side = f"  RX {'B' if one.fd else '-'} -" if "x" in extra else ""
        size = f"[{len(one.data):02d}]" if one.fd else f" [{len(one.data)}]"
        data = " ".join(f"{byte:02X}" for byte in one.data)
        if "S" in extra:
            data = "`".join(f"{byte:02X}" for byte in reversed(one.data))
        tail = "   '" + "." * len(one.data) + "'" if "a" in extra else ""
        line = f" ({time})  can{one.channel}{side}  {number:>8}  {size}  {data}{tail}"
        lines.append(f"\x1b[32m{line}\x1b[0m" if "c" in extra else line)
    return lines


def candump(frames: Sequence[Sample], *arguments: object, **keys: object) -> str:
    return "\n".join(candump_lines(frames, *arguments, **keys)) + "\n"  # type: ignore[arg-type]


TRC_COLUMNS = {"2.0": "N,O,T,I,d,l,D", "2.1": "N,O,T,B,I,d,R,L,D"}


def trc_lines(frames: Sequence[Sample], version: str) -> list[str]:
    lines = []
    for k, one in enumerate(frames, 1):
        time = f"{one.time / 1e6:.3f}"
        number = f"{one.identifier:08X}" if one.extended else f"{one.identifier:04X}"
        data = " ".join(f"{byte:02X}" for byte in one.data)
        size, bus, kind = len(one.data), one.channel, "FD" if one.fd else "DT"
        code = can.util.len2dlc(size)
        lines.append(
            {
                "1.0": f"{k:6d}) {time:>10} {number:>8}  {size} {data}",
                "1.1": f"{k:6d}) {time:>12}  Rx     {number:>8}  {size}  {data}",
                "1.2": f"{k:6d}) {time:>12} {bus}  Rx     {number:>8}  {size}  {data}",
                "1.3": f"{k:6d}) {time:>12} {bus}  Rx    {number:>8} -  {size}    {data}",
                "2.0": f"{k:7d} {time:>13} {kind} {number:>8} Rx {size:<2} {data}",
                "2.1": f"{k:7d} {time:>13} {kind} {bus}  {number:>8} Rx -  {code:<2} {data}",
            }[version]
        )
    return lines


def trc(frames: Sequence[Sample], version: str) -> str:
    head = "" if version == "1.0" else f";$FILEVERSION={version}\n;$STARTTIME=46090.4166666667\n"
    if version in TRC_COLUMNS:
        head += f";$COLUMNS={TRC_COLUMNS[version]}\n"
    return head + ";   Start time: 09.03.2026\n;---+--\n" + "\n".join(trc_lines(frames, version)) + "\n"


def gvret(frames: Sequence[Sample], directions: bool = True) -> str:
    """As SavvyCAN writes it: µs, and a comma behind the last byte."""
    cells = [
        "Time Stamp",
        "ID",
        "Extended",
        *["Dir"] * directions,
        "Bus",
        "LEN",
        *(f"D{k}" for k in range(1, 9)),
    ]
    direction = ["Rx"] * directions
    rows = [
        [
            *(f"{one.time // 1000}", f"{one.identifier:08X}", str(one.extended).lower(), *direction),
            *(f"{one.channel}", f"{len(one.data)}", *(f"{byte:02X}" for byte in one.data), ""),
        ]
        for one in frames
    ]
    return "\n".join(",".join(row) for row in [cells, *rows]) + "\n"


def blf_object(kind: int, content: bytes) -> bytes:
    """An object of a BLF file that is no frame, with a head of version 1."""
    from can.io import blf

    size = blf.OBJ_HEADER_BASE_STRUCT.size + blf.OBJ_HEADER_V1_STRUCT.size
    head = blf.OBJ_HEADER_BASE_STRUCT.pack(b"LOBJ", size, 1, size + len(content), kind)
    return head + blf.OBJ_HEADER_V1_STRUCT.pack(2, 0, 0, 0) + content


def with_objects(content: bytes, objects: bytes) -> bytes:
    """A BLF file with a container of more objects behind its own."""
    from can.io import blf

    packed = blf.LOG_CONTAINER_STRUCT.pack(0, len(objects)) + objects
    size = blf.OBJ_HEADER_BASE_STRUCT.size + len(packed)
    head = blf.OBJ_HEADER_BASE_STRUCT.pack(
        b"LOBJ", blf.OBJ_HEADER_BASE_STRUCT.size, 1, size, blf.LOG_CONTAINER
    )
    buffer = io.BytesIO(content)
    buffer.seek(0, io.SEEK_END)
    buffer.write(head + packed + b"\0" * (size % 4))
    return buffer.getvalue()
