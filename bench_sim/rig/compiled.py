"""How the rig's tick is compiled: as the model is, and anew when what stands beside the model in it changes."""

from importlib.resources import files
from typing import Final

from bench_sim.model.compiled import Compiler, digest_of

#: The modules of the rig that the compiled tick contains beside its own.
OF_THE_TICK: Final = (
    "black_box",
    "car",
    "commands",
    "controls",
    "elsewhere",
    "faults/in_tick",
    "heartbeat",
    "lateness",
    "limits",
    "safe_position",
    "setpoints",
)
_TICK: Final = Compiler(digest_of(files("bench_sim.rig") / f"{name}.py" for name in OF_THE_TICK))
compiled, compiled_once, compiled_entry = _TICK.compiled, _TICK.once, _TICK.entry
