"""Frames in MDF 4 files of CANape, CANoe and small loggers: python-can reads them, and skipped content is counted."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from bench_protocol.account import Account
from bench_protocol.extras import lacking, no_destructor_errors
from bench_protocol.input_limits import Unfit, check_mdf
from drivers.can_files.frames import CanLogError, Frames, Kind
from drivers.can_files.text import ERRORS, REMOTE, opened

_NS: Final = 10**9
_BUS_EVENTS: Final = 2  #: flag of a group that holds events on a bus
_A_BUS, _CAN = 2, 2  #: kinds of a source, and of a bus, in the standard
_DATA: Final = "CAN_DataFrame"
_FRAMES: Final = (_DATA, "CAN_ErrorFrame", "CAN_RemoteFrame")
_MDF: Final = b"MDF"
_EXTENDED: Final = f"{_DATA}.IDE"


def read_mdf_frames(path: Path, account: Account) -> Frames:
    """Return the data frames of an MDF 4 file with raw bus logging. Raises CanLogError for other files or without
    asammdf.
    """
    with opened(path) as file:
        if file.read(len(_MDF)) != _MDF:  # python-can's reader would not close it
            raise CanLogError(
                f"{path} is not an MDF file: it does not begin with {_MDF.decode()}; give it the "
                "ending of its format"
            )
    try:
        import asammdf  # noqa: F401  python-can's reader needs it, and its own error for it has another text
        from can.io.mf4 import MF4Reader
    except ImportError:
        raise CanLogError(lacking("mdf", "MDF files")) from None
    frames = Frames("frame")
    with no_destructor_errors():
        made = _open_or_none(MF4Reader, path)
    if made is None:
        raise CanLogError(
            f"{path} cannot be read: the MDF file is damaged, or its format is unsupported; export it again"
        )
    try:
        with made as reader:
            check_mdf(path, reader._mdf.groups)
            _check_groups(path, reader._mdf, account)
            for number, message in enumerate(reader, 1):
                if message.is_error_frame:
                    account.leave_out(ERRORS)
                elif message.is_remote_frame:
                    account.leave_out(REMOTE)
                else:
                    channel = "1" if message.channel is None else str(message.channel)
                    kind = Kind(channel, message.arbitration_id, message.is_extended_id, message.is_fd)
                    frames.add(round(message.timestamp * _NS), kind, bytes(message.data), number)
    except CanLogError:
        raise
    except Unfit as error:
        raise CanLogError(f"{path} {error}") from None
    except Exception:  # asammdf raises its own exception and others
        raise CanLogError(
            f"{path} cannot be read after frame {len(frames)}: the MDF file is damaged, or its format "
            "is unsupported; export it again"
        ) from None
    return frames


def _open_or_none(kind: Any, path: Path) -> Any:
    try:
        return kind(path)
    except Exception:  # asammdf raises its own exception and others
        return None


def _check_groups(path: Path, mdf: Any, account: Account) -> None:
    """Count groups without CAN frames. Raises CanLogError for frames with an unknown bus or length of identifiers."""
    for number, group in enumerate(mdf.groups):
        names = {channel.name for channel in group.channels}
        if not group.channel_group.cycles_nr:
            continue
        if not names & set(_FRAMES):
            account.leave_out("group(s) without CAN frames", at=f"group {number}")
        elif not group.channel_group.flags & _BUS_EVENTS or not _is_can(group.channel_group.acq_source):
            raise CanLogError(
                f"{path}: group {number} has frames, but its source is not marked as a CAN bus; export "
                "it with the bus type CAN"
            )
        elif _DATA in names and _EXTENDED not in names:
            raise CanLogError(
                f"{path}: group {number} does not state which identifiers have 29 bits; export it with "
                f"the channel {_EXTENDED}"
            )


def _is_can(source: Any) -> bool:
    return source is not None and bool(source.source_type & _A_BUS) and source.bus_type == _CAN
