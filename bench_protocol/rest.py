"""Settings at rest of a bench without a commander."""

from collections.abc import Mapping
from typing import Final

from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.words import SIDES

#: Parts that are fitted by hand, and the settings that describe them, do not change at rest.
FITTED: Final = ("rig.nominal_preload", "rig.orifice_diameter", "rig.pipe")
#: Valves between chambers: they move no air while the bench holds, and return with the safe position.
CONNECTING: Final = (*(f"air.{side}_reservoir" for side in SIDES), "air.dpv")
#: Values at rest except for fitted parts; a rig starts with them.
REST: Final[Mapping[str, float]] = {
    signal.name: signal.default for signal in TABLE.of_kind(Kind.SETTING) if signal.name not in FITTED
}
