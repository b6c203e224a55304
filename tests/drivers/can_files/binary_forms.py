"""One recording in every form that binary logs have: objects of BLF by hand, raw bus logging of MDF 4 by asammdf."""

import random
import struct
import tempfile
import zlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import can
import numpy as np
from can.io import blf as vector

from tests.drivers.can_files.log_forms import START, Sample

_V1: Final = struct.Struct("<4sHHLLLHHQ")
_V2: Final = struct.Struct("<4sHHLLLBxHQ8x")
_TEN_US, _NS = 1, 2
#: Other objects than frames in a BLF: text of a user, statistics, an error frame, an overload frame.
BESIDE_BLF: Final = (65, 4, 2, 3)


def _object(rng: random.Random, kind: int, time: int, content: bytes) -> bytes:
    unit, ticks = rng.choice([(_NS, time), (_TEN_US, time // 10_000)])
    if rng.random() < 0.5:
        head = _V1.pack(b"LOBJ", _V1.size, 1, _V1.size + len(content), kind, unit, 0, 0, ticks)
    else:
        head = _V2.pack(b"LOBJ", _V2.size, 2, _V2.size + len(content), kind, unit, 0, 0, ticks)
    return head + content + b"\0" * (len(content) % 4)


def _frame(rng: random.Random, one: Sample) -> bytes:
    number = one.identifier | one.extended << 31
    size, code = len(one.data), can.util.len2dlc(len(one.data))
    kinds = [vector.CAN_FD_MESSAGE, vector.CAN_FD_MESSAGE_64]
    kind = rng.choice(kinds if one.fd else [vector.CAN_MESSAGE, vector.CAN_MESSAGE2, *kinds])
    if kind in (vector.CAN_MESSAGE, vector.CAN_MESSAGE2):
        content = vector.CAN_MSG_STRUCT.pack(one.channel, 0, size, number, one.data)
        content += struct.pack("<LBBH", 230_000, 118, 0, 0) if kind == vector.CAN_MESSAGE2 else b""
    elif kind == vector.CAN_FD_MESSAGE:
        flags = 1 if one.fd else 0
        content = vector.CAN_FD_MSG_STRUCT.pack(one.channel, 0, code, number, 0, 0, flags, size, one.data)
    else:
        flags = 0x1000 if one.fd else 0
        content = vector.CAN_FD_MSG_64_STRUCT.pack(
            one.channel, code, size, 0, number, 0, flags, 0, 0, 0, 0, 0, 0, 0, 0
        )
        content += one.data
    return _object(rng, kind, one.time, content)


def blf(rng: random.Random, frames: Sequence[Sample], beside: int = 0) -> bytes:
    """Frames as objects of any kind, plus ``beside``, in containers of any size that objects may go across."""
    objects = [_frame(rng, one) for one in frames]
    for _ in range(beside):
        place = rng.randrange(len(objects) + 1)
        time = frames[min(place, len(frames) - 1)].time
        objects.insert(place, _object(rng, rng.choice(BESIDE_BLF), time, rng.randbytes(16)))
    inner = b"".join(objects)
    size = rng.choice([97, 1000, 128 * 1024])
    body = b""
    for start in range(0, len(inner), size):
        part = inner[start : start + size]
        method = rng.choice([vector.NO_COMPRESSION, vector.ZLIB_DEFLATE])
        packed = vector.LOG_CONTAINER_STRUCT.pack(method, len(part))
        packed += zlib.compress(part) if method == vector.ZLIB_DEFLATE else part
        head = vector.OBJ_HEADER_BASE_STRUCT
        body += head.pack(b"LOBJ", head.size, 1, head.size + len(packed), vector.LOG_CONTAINER) + packed
        body += b"\0" * ((head.size + len(packed)) % 4)
    day = vector.timestamp_to_systemtime(START / 1e9)
    head = vector.FILE_HEADER_STRUCT.pack(
        b"LOGG", vector.FILE_HEADER_SIZE, 5, 0, 0, 0, 2, 6, 8, 1,
        vector.FILE_HEADER_SIZE + len(body), vector.FILE_HEADER_SIZE + len(inner), len(objects), 0, *day, *day,
    )  # fmt: skip
    return head.ljust(vector.FILE_HEADER_SIZE, b"\0") + body


def _group(frames: Sequence[Sample], what: str, room: int, fd: bool) -> np.ndarray:
    fields: list[Any] = [
        ("BusChannel", "<u1"),
        ("ID", "<u4"),
        ("IDE", "<u1"),
        ("DLC", "<u1"),
        ("DataLength", "<u1"),
    ]
    fields += [("DataBytes", f"({room},)u1")] * (what != "CAN_RemoteFrame") + [("EDL", "<u1")] * fd
    found = np.zeros(len(frames), [(f"{what}.{name}", *rest) for name, *rest in fields])
    for row, one in zip(found, frames, strict=True):
        size = len(one.data)
        content: dict[str, Any] = {"BusChannel": one.channel, "ID": one.identifier, "IDE": one.extended}
        content |= {"DLC": can.util.len2dlc(size), "DataLength": size, "EDL": one.fd}
        content["DataBytes"] = np.frombuffer(one.data.ljust(room, b"\0"), np.uint8)
        for name, *_ in fields:
            row[f"{what}.{name}"] = content[name]
    return found


def mdf(rng: random.Random, frames: Sequence[Sample], beside: int = 0, kind: str = "CAN") -> bytes:
    """Frames in one group, or one of each channel or format, plus ``beside`` error frames, remote frames, a signal."""
    from asammdf import MDF, Signal
    from asammdf.blocks.source_utils import Source

    bus = Source("", "", "", Source.SOURCE_BUS, getattr(Source, f"BUS_TYPE_{kind}"))
    parts = {"all": lambda one: 0, "channel": lambda one: one.channel, "extended": lambda one: one.extended}
    key = parts[rng.choice(sorted(parts))]
    fd = any(one.fd for one in frames) or rng.random() < 0.5
    room = 64 if any(len(one.data) > 8 for one in frames) else rng.choice([8, 64])
    groups = [
        ("CAN_DataFrame", [one for one in frames if key(one) == value])
        for value in sorted({*map(key, frames)})
    ]
    for _ in range(beside):
        what = rng.choice(["CAN_ErrorFrame", "CAN_RemoteFrame", "CAN_ErrorFrame"])
        groups.insert(rng.randrange(len(groups) + 1), (what, list(frames[:3])))
    with (
        tempfile.TemporaryDirectory() as folder,
        MDF(version=rng.choice(["4.00", "4.10", "4.11", "4.20"])) as file,
    ):
        file.header.start_time = datetime.fromtimestamp(START // 10**9, UTC)
        for what, some in groups:
            times = np.array([one.time for one in some]) / 1e9
            file.append(Signal(_group(some, what, room, fd), times, name=what, source=bus))
            file.groups[-1].channel_group.flags |= 2 | 4  # events on a bus, in the form of the standard
        if beside and rng.random() < 0.5:
            file.append(Signal(np.arange(9.0), np.arange(9.0), name="Temperature"))
        path = Path(folder) / "a.mf4"
        file.save(path, compression=rng.choice([0, 1, 2]))
        return path.read_bytes()
