"""The points of a rig from its DBC and its list of registers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from astb.acceptance.skeleton.written_units import unit_of
from bench_protocol.dbc import DbcError, read_dbc
from bench_protocol.no_value import no_value_codes
from drivers.errors import WiringError


@dataclass(frozen=True)
class DescribedPoint:
    """One point: its name on the rig, and its description."""

    name: str  #: as the wiring names it: TRANSPORT.POINT
    own: str  #: words of its name
    context: str  #: words of its context: its message, its description
    unit: str
    written: bool  #: by a client
    read: bool
    choices: Mapping[str, int] = field(default_factory=dict)
    line: str = ""  #: of ``[transports.NAME.points]``
    nulls: Mapping[int, str] = field(
        default_factory=dict
    )  #: raw values that are not measurements, with their names
    absolute: bool = False  #: an absolute pressure, where ours are gauge pressures


#: Default sender in a DBC, if no node is named.
_NOBODY: Final = re.compile(r"(vector_*)?xxx", re.IGNORECASE)


def dbc_points(path: Path, transport: str = "bus", charset: str | None = None) -> list[DescribedPoint]:
    """Return the signals of a DBC as points. The node that sends most of them is taken as the rig.

    Signals without a sender may be sent by the rig or by a client. Raises WiringError for a file in another format.
    """
    try:
        messages = read_dbc(path, charset).messages
    except DbcError as error:
        raise WiringError(str(error)) from None
    senders = {
        name: [one for one in message.coding.senders if not _NOBODY.fullmatch(one)]
        for name, message in messages.items()
    }
    counts = Counter(
        sender for name, one in messages.items() for sender in senders[name] for _ in one.coding.signals
    )
    rig = counts.most_common(1)[0][0] if counts else ""
    return [
        DescribedPoint(
            f"{transport}.{name}.{signal.name}",
            signal.name,
            f"{one.coding.name} {signal.comment or ''}",
            unit.name if unit.factor == 1.0 else signal.unit or "",
            written=rig not in senders[name],
            read=not senders[name] or rig in senders[name],
            absolute=unit.absolute,
            choices={
                str(text): int(number)
                for number, text in (signal.choices or {}).items()
                if int(number) not in nulls
            },
            nulls=nulls,
        )
        for name, one in messages.items()
        for signal in one.coding.signals
        for unit, nulls in [(unit_of(signal.unit or ""), no_value_codes(signal))]
    ]
