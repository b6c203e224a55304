"""Plants for the model's tests: parameter sets without this or that, so that closed forms hold."""

from collections.abc import Callable

import pytest

from bench_sim.model.plant import Plant
from bench_sim.parameters import Parameters, load

BASE = load("astb")

WITHOUT: dict[str, dict[str, object]] = {
    "emergency_spring": {"emergency_spring": 0},
    "rubber": {
        "shell_stiffness_vertical": 0,
        "shell_stiffness_lateral": 0,
        "friction_vertical": 0,
        "friction_lateral": 0,
        "friction_lateral_slope": 0,
    },
    "friction": {"friction_vertical": 0, "friction_lateral": 0, "friction_lateral_slope": 0},
    "heat": {"bellows_heat_transfer": 0, "auxiliary_heat_transfer": 0},
    "noise": {"sensor_noise": 0.0, "sensor_resolution": 0.0},
}


def _parameters(load_case: str = "AW0", without: tuple[str, ...] = (), **changes: object) -> Parameters:
    merged: dict[str, object] = {}
    for part in without:
        merged |= WITHOUT[part]
    return BASE.under(load_case).with_values(**(merged | changes))


@pytest.fixture(scope="session")
def parameters() -> Callable[..., Parameters]:
    """``parameters("AW3", without=("heat",), orifice_diameter=0.06)``."""
    return _parameters


@pytest.fixture(scope="session")
def resting() -> Callable[..., Plant]:
    """As ``parameters``, but the plant at rest with them."""

    def build(load_case: str = "AW0", without: tuple[str, ...] = (), **changes: object) -> Plant:
        return Plant.at_rest(_parameters(load_case, without, **changes).record)

    return build
