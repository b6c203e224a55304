"""Access of a plan to the rig's black box: the stored incident, and whether a new one was added."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench_protocol.black_box import Incident, read_head, read_incident
from bench_protocol.modbus import FILE_READ_MAX
from bench_protocol.units import s
from drivers.errors import BenchError

if TYPE_CHECKING:
    from drivers.bench import Bench

#: The rig records ten seconds beyond the incident.
_RECORDED_WITHIN: Final = 12 * s
_LOOK: Final = 0.5 * s


def last_incident(bench: Bench) -> int:
    """Return the number of the incident in the black box; 0 if there is no incident or no black box, or if it cannot be
    read.
    """
    if not bench.wiring.capabilities.files:
        return 0
    try:
        return read_head(bench.wiring.read_file).number
    except (BenchError, ValueError):
        return 0


def incident_since(bench: Bench, number: int) -> Incident | None:
    """Return the incident that was stored after incident ``number``. Return None if there is none, or if the rig is
    lost or has no black box. If the rig is still recording the incident, wait for the end of the recording, at most
    `_RECORDED_WITHIN` s.
    """
    if not bench.wiring.capabilities.files:
        return None
    read = bench.wiring.read_file
    try:
        with bench.despite_faults():
            deadline = bench.now + _RECORDED_WITHIN
            while (head := read_head(read)).recording and bench.now < deadline:
                bench.wait(_LOOK)
        return read_incident(read, FILE_READ_MAX) if head.number not in (0, number) else None
    except (BenchError, ValueError):
        return None
