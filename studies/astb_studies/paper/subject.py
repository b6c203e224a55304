"""The parameter sets under test, as shipped or changed, and the plants that are built from them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, wraps
from inspect import signature
from typing import Any, Final, TypeVar, cast

from astb_studies.paper.closed_form import PaperParameters
from astb_studies.paper.parameters import PaperSet, load_paper
from astb_studies.paper.wind import Crosswind
from bench_protocol.units import kN
from bench_sim.model.experiments import isolate
from bench_sim.model.plant import Plant
from bench_sim.parameters import Parameters, load
from bench_sim.parameters.vehicle import VehicleParameters, load_vehicle

#: The paper's load cases and their preload per spring.
LOADS: Final = {"AW0": 53.5 * kN, "AW3": 145 * kN}

_NO_FRICTION: Final = {"friction_vertical": 0, "friction_lateral": 0, "friction_lateral_slope": 0}

#: Parts that an experiment takes out of the plant, so that a closed form holds.
WITHOUT: Final[dict[str, dict[str, Any]]] = {
    "emergency_spring": {"emergency_spring": 0},
    "friction": _NO_FRICTION,
    "relaxation": {"maxwell_ratio": 0},
    "rubber": {"shell_stiffness_vertical": 0, "shell_stiffness_lateral": 0} | _NO_FRICTION,
    "heat": {"bellows_heat_transfer": 0, "auxiliary_heat_transfer": 0},
}

#: Gas and membrane alone.
BARE: Final = ("emergency_spring", "rubber")

#: So much heat exchange that the gas keeps the temperature of its wall.
ISOTHERMAL: Final = {"bellows_heat_transfer": 1000.0, "auxiliary_heat_transfer": 1000.0}


@dataclass(frozen=True, eq=False)
class Subject:
    """The parameter sets of plant, paper (its wind included) and car, each as changes (SI) to the shipped set.

    ``quick`` uses one realisation of the wind instead of ten. Results that several checks need are computed once.
    """

    plant: Mapping[str, Any] = field(default_factory=dict)
    paper: Mapping[str, Any] = field(default_factory=dict)
    car: Mapping[str, Any] = field(default_factory=dict)
    quick: bool = False
    _memo: dict[Any, Any] = field(default_factory=dict, repr=False)

    @cached_property
    def _bench(self) -> Parameters:
        return load("astb").with_values(**self.plant)

    @cached_property
    def _paper(self) -> PaperSet:
        return load_paper().with_values(**self.paper)

    @cached_property
    def vehicle(self) -> VehicleParameters:
        """The car on its track."""
        return load_vehicle().with_values(**self.car)

    @property
    def wind(self) -> Crosswind:
        """The wind on a car, for `astb_studies.paper.wind`."""
        return self._paper.wind

    def parameters(self, load_case: str, *without: str, **changes: Any) -> Parameters:
        """Return the plant's set under a load case, without some parts (`WITHOUT`), and with ``changes``."""
        conditions: dict[str, Any] = {}
        for part in without:
            conditions |= WITHOUT[part]
        return self._bench.under(load_case).with_values(**(conditions | changes))

    def resting(self, load_case: str, *without: str, **changes: Any) -> Plant:
        """Return the bench at rest, its valves closed, with `parameters` of the same arguments."""
        plant = Plant.at_rest(self.parameters(load_case, *without, **changes).record)
        isolate(plant)
        return plant

    def spring(self, load_case: str, **changes: Any) -> PaperParameters:
        """Return the paper's spring under a load case."""
        return self._paper.under(load_case).with_values(**changes).spring


_Experiment = TypeVar("_Experiment", bound=Callable[..., Any])


def remembered(experiment: _Experiment) -> _Experiment:
    """Cache the results of an experiment by subject and arguments, because several checks use them. Positional,
    keyword and default arguments with equal values are equal.
    """
    parameters = signature(experiment)

    @wraps(experiment)
    def once(subject: Subject, *args: Any, **changes: Any) -> Any:
        given = parameters.bind(subject, *args, **changes)
        given.apply_defaults()
        key = (experiment.__name__, given.args[1:], tuple(sorted(given.kwargs.items())))
        if key not in subject._memo:
            subject._memo[key] = experiment(subject, *args, **changes)
        return subject._memo[key]

    return cast(_Experiment, once)
