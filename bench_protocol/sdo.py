"""The server of CANopen's SDO protocol without a bus: it answers eight bytes of a request with eight of the response.

Source: CiA 301, section 7.2.4: expedited and segmented transfers. Block transfers are refused, as the standard allows.
A server has one client and one transfer at a time; a new transfer replaces an unfinished one.
"""

import struct
from enum import IntEnum
from typing import Final, Protocol


class AbortCode(IntEnum):
    """Reasons for which a transfer is refused."""

    TOGGLE = 0x0503_0000
    COMMAND_UNKNOWN = 0x0504_0001
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    INCOMPATIBLE = 0x0604_0043
    TOO_LONG = 0x0607_0012
    TOO_SHORT = 0x0607_0013
    NO_SUB_INDEX = 0x0609_0011
    VALUE_INVALID = 0x0609_0030
    VALUE_TOO_HIGH = 0x0609_0031
    VALUE_TOO_LOW = 0x0609_0032
    LOCAL_CONTROL = 0x0800_0021
    DEVICE_STATE = 0x0800_0022
    NO_DATA = 0x0800_0024


class SdoAbort(Exception):
    """The transfer is refused with this code."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(f"{code.name.lower().replace('_', ' ')} (SDO abort {code:#010x})")
        self.code = code


class ObjectAccess(Protocol):
    """The values of an object dictionary; a method that raises SdoAbort has not changed anything."""

    def size(self, index: int, sub: int) -> int:
        """Return the bytes of an entry; 0 for any length."""

    def read(self, index: int, sub: int) -> bytes: ...

    def write(self, index: int, sub: int, data: bytes) -> None: ...


_HEAD: Final = struct.Struct("<BHB4s")
_ABORT: Final = struct.Struct("<BHBI")
_FRAME_BYTES: Final = 8
_EXPEDITED_MAX: Final = 4
_SEGMENT_MAX: Final = 7
#: Bytes; no writable entry of the dictionary is longer.
_DOWNLOAD_MAX: Final = 64


class _Request(IntEnum):
    """The upper three bits of a request's first byte."""

    DOWNLOAD_SEGMENT = 0
    DOWNLOAD = 1
    UPLOAD = 2
    UPLOAD_SEGMENT = 3
    ABORT = 4


# The same bits in the first byte of a response, shifted to their place.
_SEGMENT_UPLOADED, _SEGMENT_DOWNLOADED, _UPLOADING, _DOWNLOADING, _ABORTED = (k << 5 for k in range(5))
_TOGGLE: Final = 0x10
_LAST: Final = 0x01
_EXPEDITED: Final = 0x02
_SIZED: Final = 0x01


class _Transfer:
    """The state of a segmented transfer: the data still to be sent, or received so far."""

    def __init__(self, index: int, sub: int, data: bytes = b"", *, download: bool) -> None:
        self.index, self.sub = index, sub
        self.data = data
        self.download = download
        self.toggle = 0

    def accept(self, command: int) -> None:
        """Raise SdoAbort if the toggle bit of a segment is wrong; invert the expected one for the next segment."""
        if command & _TOGGLE != self.toggle:
            raise SdoAbort(AbortCode.TOGGLE)
        self.toggle ^= _TOGGLE


class SdoServer:
    """Answers the requests of one client with the values of ``objects``."""

    def __init__(self, objects: ObjectAccess) -> None:
        self._objects = objects
        self._transfer: _Transfer | None = None

    def answer(self, request: bytes) -> bytes | None:
        """Return the response to ``request``; None for an abort or a frame of another length."""
        if len(request) != _FRAME_BYTES:
            return None
        command, index, sub, rest = _HEAD.unpack(request)
        specifier = command >> 5
        if specifier == _Request.ABORT:
            self._transfer = None
            return None
        if specifier in (_Request.DOWNLOAD_SEGMENT, _Request.UPLOAD_SEGMENT) and self._transfer is not None:
            index, sub = self._transfer.index, self._transfer.sub
        try:
            match specifier:
                case _Request.DOWNLOAD_SEGMENT:
                    return self._download_segment(request)
                case _Request.DOWNLOAD:
                    return self._download(command, index, sub, rest)
                case _Request.UPLOAD:
                    return self._upload(index, sub)
                case _Request.UPLOAD_SEGMENT:
                    return self._upload_segment(command)
            raise SdoAbort(AbortCode.COMMAND_UNKNOWN)
        except SdoAbort as refusal:
            self._transfer = None
            return _ABORT.pack(_ABORTED, index, sub, refusal.code)

    def _upload(self, index: int, sub: int) -> bytes:
        self._transfer = None
        data = self._objects.read(index, sub)
        if 1 <= len(data) <= _EXPEDITED_MAX:
            unused = _EXPEDITED_MAX - len(data)
            return _HEAD.pack(_UPLOADING | unused << 2 | _EXPEDITED | _SIZED, index, sub, data)
        self._transfer = _Transfer(index, sub, data, download=False)
        return _HEAD.pack(_UPLOADING | _SIZED, index, sub, len(data).to_bytes(4, "little"))

    def _upload_segment(self, command: int) -> bytes:
        transfer = self._under_way(download=False)
        transfer.accept(command)
        segment, transfer.data = transfer.data[:_SEGMENT_MAX], transfer.data[_SEGMENT_MAX:]
        last = not transfer.data
        if last:
            self._transfer = None
        head = _SEGMENT_UPLOADED | command & _TOGGLE | (_SEGMENT_MAX - len(segment)) << 1 | last
        return bytes((head,)) + segment.ljust(_SEGMENT_MAX, b"\0")

    def _download(self, command: int, index: int, sub: int, rest: bytes) -> bytes:
        self._transfer = None
        sized = bool(command & _SIZED)
        if command & _EXPEDITED:
            given = _EXPEDITED_MAX - (command >> 2 & 3) if sized else self._objects.size(index, sub)
            self._objects.write(index, sub, rest[:given])
        else:
            if sized and int.from_bytes(rest, "little") > _DOWNLOAD_MAX:
                raise SdoAbort(AbortCode.TOO_LONG)
            self._transfer = _Transfer(index, sub, download=True)
        return _HEAD.pack(_DOWNLOADING, index, sub, b"")

    def _download_segment(self, request: bytes) -> bytes:
        command = request[0]
        transfer = self._under_way(download=True)
        transfer.accept(command)
        transfer.data += request[1 : _FRAME_BYTES - (command >> 1 & 7)]
        if len(transfer.data) > _DOWNLOAD_MAX:
            raise SdoAbort(AbortCode.TOO_LONG)
        if command & _LAST:
            self._transfer = None
            self._objects.write(transfer.index, transfer.sub, transfer.data)
        return bytes((_SEGMENT_DOWNLOADED | command & _TOGGLE,)).ljust(_FRAME_BYTES, b"\0")

    def _under_way(self, *, download: bool) -> _Transfer:
        if self._transfer is None or self._transfer.download is not download:
            raise SdoAbort(AbortCode.COMMAND_UNKNOWN)
        return self._transfer
