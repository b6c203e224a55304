"""Converts blocks of CAN frames to bytes of a capture in the format pcapng, which Wireshark reads.

Sources: the pcapng draft of the IETF (draft-ietf-opsawg-pcapng) and the link type 227, LINKTYPE_CAN_SOCKETCAN, of
tcpdump.org: the identifier with its flags big-endian, the length, and eight bytes of data.
"""

import struct
from typing import Final

import numpy as np

from bench_protocol.frames import FRAME, LENGTH_MAX, Block

LINK_TYPE: Final = 227
#: Start of a capture, by which tools identify the format, wherever a live stream was joined.
_MAGIC: Final = 0x1A2B3C4D
_SECTION, _INTERFACE, _STATISTICS, _PACKET = 0x0A0D0D0A, 1, 5, 6
_EXTENDED_FLAG: Final = 0x8000_0000
#: Options by their codes.
_END, _NAME, _APPLICATION, _RESOLUTION, _DROPPED, _FLAGS = 0, 2, 4, 9, 5, 2
_NANOSECONDS: Final = 9  # time stamps are multiples of 10⁻⁹ s
_INBOUND, _OUTBOUND = 1, 2

_PACKETS: Final = np.dtype(
    [
        ("type", "<u4"),
        ("total", "<u4"),
        ("interface", "<u4"),
        ("time_high", "<u4"),
        ("time_low", "<u4"),
        ("captured", "<u4"),
        ("original", "<u4"),
        ("id", ">u4"),
        ("length", "u1"),
        ("pad", "u1", (3,)),
        ("data", "u1", (LENGTH_MAX,)),
        ("flags_code", "<u2"),
        ("flags_length", "<u2"),
        ("flags", "<u4"),
        ("end_code", "<u2"),
        ("end_length", "<u2"),
        ("total_again", "<u4"),
    ]
)
_FRAME_BYTES: Final = 16


def header_bytes(bus: str, application: str = "astb") -> bytes:
    """Return the header of a capture of ``bus``: a section with one interface, with times in ns."""
    section = struct.pack("<IHHq", _MAGIC, 1, 0, -1) + _options((_APPLICATION, application.encode()))
    interface = struct.pack("<HHI", LINK_TYPE, 0, 0)
    interface += _options((_NAME, bus.encode()), (_RESOLUTION, bytes((_NANOSECONDS,))))
    return _block(_SECTION, section) + _block(_INTERFACE, interface)


def packet_bytes(block: Block, *, outbound: bool) -> bytes:
    """Return one packet for each frame of ``block`` (times in ns since 1970). ``outbound`` is True for frames of the
    rig.

    Raises TypeError if the array is not a frame block.
    """
    if block.dtype != FRAME:
        raise TypeError(f"block = array of {block.dtype} is not a frame block (bench_protocol.frames.FRAME)")
    packets = np.zeros(block.size, _PACKETS)
    packets["type"] = _PACKET
    packets["total"] = packets["total_again"] = _PACKETS.itemsize
    packets["time_high"] = block["time"] >> 32
    packets["time_low"] = block["time"] & 0xFFFF_FFFF
    packets["captured"] = packets["original"] = _FRAME_BYTES
    packets["id"] = block["id"] | np.where(block["extended"], _EXTENDED_FLAG, 0).astype(np.uint32)
    packets["length"], packets["data"] = block["length"], block["data"]
    packets["flags_code"], packets["flags_length"] = _FLAGS, 4
    packets["flags"] = _OUTBOUND if outbound else _INBOUND
    return packets.tobytes()


def statistics_bytes(time: int, dropped: int) -> bytes:
    """Return the statistics of the interface at ``time`` (ns since 1970), with the number of ``dropped`` frames."""
    body = struct.pack("<III", 0, time >> 32, time & 0xFFFF_FFFF)
    return _block(_STATISTICS, body + _options((_DROPPED, struct.pack("<Q", dropped))))


def _options(*options: tuple[int, bytes]) -> bytes:
    parts = [struct.pack("<HH", code, len(value)) + _padded(value) for code, value in options]
    return b"".join(parts) + struct.pack("<HH", _END, 0)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _block(kind: int, body: bytes) -> bytes:
    total = 12 + len(body)
    return struct.pack("<II", kind, total) + body + struct.pack("<I", total)
