"""What is in force on a bench that nobody commands: its settings at rest."""

from collections.abc import Mapping
from typing import Final

from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.words import SIDES

#: What hands have fitted stays fitted, and its settings say what that is.
FITTED: Final = ("rig.nominal_preload", "rig.orifice_diameter", "rig.pipe")
#: Valves between chambers: while the bench holds they move no air, and return with the safe position.
CONNECTING: Final = (*(f"air.{side}_reservoir" for side in SIDES), "air.dpv")
#: What is in force at rest, but for what is fitted: what a rig begins with.
REST: Final[Mapping[str, float]] = {
    signal.name: signal.default for signal in TABLE.of_kind(Kind.SETTING) if signal.name not in FITTED
}
