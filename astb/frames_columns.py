"""Signals in a log of CAN frames as columns for a map."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from astb.frames_import import LogKeys, read_frames_of
from bench_protocol.account import Account
from bench_records.layout import RecordError
from bench_records.tables.reading import Series
from diagnosis.contracts import DiagnosisError
from drivers.can_files.reading import OTHER_FORMS, frames_form, log_of_others

if TYPE_CHECKING:
    from bench_records.tables.keys import Source
    from diagnosis.systems.map_file import FrameKeys


def columns_of_frames(
    path: Path, keys: FrameKeys, beside: Path, wanted: Mapping[str, Source], account: Account
) -> dict[str, Series] | None:
    """Return the ``wanted`` signals of a log, each with its own times; None for a file that is none.

    MDF files are logs where the keys name a DBC. DiagnosisError names the file, the key and what would be right.
    """
    if frames_form(path, keys.dbc is not None) is None:
        if path.is_file() and (what := log_of_others(path)):
            raise DiagnosisError(f"{path} is {what}, not a table of samples; {OTHER_FORMS}")
        return None
    if not path.is_file():
        raise DiagnosisError(f"{path}: no such file")
    if keys.charset is not None and keys.dbc is None:
        raise DiagnosisError(f"frames.charset = {keys.charset!r} is of the DBC, and frames.dbc names none")
    dbc = None if keys.dbc is None else beside / keys.dbc
    try:
        log = read_frames_of(path, LogKeys(dbc, keys.charset, keys.channel, keys.stamps), account)
        parts = list(log.samples())
    except RecordError as error:
        raise DiagnosisError(str(error).replace("--channel ", "frames.channel = ")) from None
    times, rows, values = (np.concatenate([part[k] for part in parts]) for k in range(3))
    index = {signal.name: place for place, signal in enumerate(log.signals)}
    found = {}
    for key, source in wanted.items():
        place = index.get(str(source.column))
        if place is None:
            raise DiagnosisError(
                f"{path}: {key}.column = {source.column!r}: the log has {', '.join(sorted(index))}"
            )
        here, signal = rows == place, log.signals[place]
        seconds = (times[here] - log.start) / 1e9
        found[key] = Series(signal.name, seconds, values[here] / signal.scale, signal.unit, log.start)
    return found
