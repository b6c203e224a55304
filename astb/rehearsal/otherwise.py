"""Changes of a simulated rig from an instant on: effects that begin there, parameters that change."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from msgspec.structs import replace

from astb.rig_file import Simulation
from astb.session import simulated_parameters
from bench_sim.parameters.effects import find_effect
from bench_sim.parameters.loading import ParameterError
from bench_sim.rig.turn import VOLUMES, differing, turn

if TYPE_CHECKING:
    from bench_sim.rig.rig import Rig

_KEPT: Final = "the mass and the energy of the gas remain, so its pressure changes at once"


class Otherwise(NamedTuple):
    """The names of the parameters that change, a record with their new values, and the changes as text."""

    names: list[str]
    record: Any
    told: list[str]

    @classmethod
    def of(
        cls, simulation: Simulation, seed: int, effects: Mapping[str, str], changes: Mapping[str, Any]
    ) -> "Otherwise":
        """Return the changes by ``effects`` and ``changes``, given as text, to the rig of a ``simulation``.

        An effect that the rig already has gets the new size. Raises ParameterError with name, value and correct form.
        """
        before = simulated_parameters(simulation).as_built(seed).record
        other = replace(
            simulation, effects={**simulation.effects, **effects}, change={**simulation.change, **changes}
        )
        after = simulated_parameters(other).as_built(seed).record
        names = differing(before, after)
        lines = [f"{name} = {_as_text(value)}" for name, value in (*effects.items(), *changes.items())]
        return cls(names, after, lines + [_KEPT] * (not VOLUMES.isdisjoint(names)))

    def begin(self, rig: "Rig", at: float) -> None:
        """Apply the changes from ``at`` s of the rig's time on.

        Raises ParameterError for springs that an FMU computes.
        """
        try:
            turn(rig, at, self.names, self.record)
        except RuntimeError as error:
            raise ParameterError(str(error)) from None


def _as_text(value: Any) -> str:
    return ", ".join(value) if isinstance(value, list) else str(value)


def exact(effects: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    """Return the effects of a record (SI) in the notation of a rig file, exact to the last bit."""
    texts = {}
    for name, values in effects.items():
        amplitude, *shapes = [
            (one.name, f"{values[one.name]!r} {one.unit}" if one.unit != "1" else repr(values[one.name]))
            for one in find_effect(name)[0].parameters
        ]
        texts[name] = ", ".join([amplitude[1], *(f"{shape}={text}" for shape, text in shapes)])
    return texts
