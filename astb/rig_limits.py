"""The limits of a rig. A limit that its file does not state is that of the simulation, or assumed for a real rig."""

from typing import Final, NamedTuple

from astb.rig_file import RigFile
from bench_protocol.words import LIMIT_KINDS
from bench_sim.rig.limit_table import limits_of
from bench_sim.rig.limits import Limit

SIMULATED: Final = "simulated rig"
TOLD: Final = "rig file"
ASSUMED: Final = "assumed"


class KnownLimit(NamedTuple):
    """A limit and its source: `SIMULATED`, `TOLD` or `ASSUMED`."""

    limit: Limit
    source: str


def known_limits(rig: RigFile) -> list[KnownLimit]:
    """Return the limits of ``rig``. Raises ValueError with key, value and correct form for an impossible limit.

    Limits missing in the file of a simulated rig are those of the simulation; those of a real rig are assumed.
    """
    rows = rig.simulation.limits if rig.simulation else rig.limits
    otherwise = SIMULATED if rig.simulation else ASSUMED
    stated = {(row.get("signal"), row.get("kind")) for row in rows}
    return [
        KnownLimit(limit, TOLD if (limit.signal, LIMIT_KINDS[limit.kind]) in stated else otherwise)
        for limit in limits_of(rows)
    ]
