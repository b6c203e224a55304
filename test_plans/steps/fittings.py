"""Changes of the bench that are made by hand on a real rig: shims, orifice plates and the connecting pipe."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Final, Literal

from bench_protocol.units import mm
from test_plans import steps

if TYPE_CHECKING:
    from test_plans.run import Run

#: Settings that `fit_plate` and `fit_pipe` change, and valves that `leave_connected` opens.
PLATES_AND_PIPE: Final = ("rig.orifice_diameter", "rig.pipe")
CONNECTIONS: Final = ("air.left_reservoir", "air.right_reservoir", "air.dpv")
#: Fitted when the bench was built.
PLATE: Final = 13 * mm


def put_down(run: Run) -> None:
    """Vent the springs and disarm the bench, so that a person may change shims, plates and the pipe."""
    steps.depressurise(run)
    with run.phase("disarm"):
        run.bench.disarm()


def fit_plate(run: Run, diameter: float) -> None:
    """Fit the orifice plates of this diameter (m) on both sides. The springs must be without air."""
    with run.phase(f"orifice plates of {diameter / mm:g} mm"):
        steps.once_let_go(run, lambda: setattr(run.bench.rig, "orifice_diameter", diameter))


def fit_pipe(run: Run, fitted: Literal["off", "on"]) -> None:
    """Fit the connecting pipes between the bellows and their auxiliary chambers ("on"), or remove them ("off")."""
    with run.phase(f"connecting pipe {fitted}"):
        steps.once_let_go(run, lambda: setattr(run.bench.rig, "pipe", fitted))


def leave_connected(run: Run) -> None:
    """Open the isolated valves and make the bench safe. Air can flow out only through open valves."""
    with ExitStack() as last_first:
        last_first.callback(steps.make_safe, run)
        last_first.callback(run.bench.air.connect_dpv)
        last_first.callback(run.bench.air.connect_reservoirs)


def leave_as_built(run: Run) -> None:
    """Make the bench safe, fit its original plates and remove the pipe."""
    with ExitStack() as last_first:
        last_first.callback(fit_plate, run, PLATE)
        last_first.callback(fit_pipe, run, "off")
        last_first.callback(steps.make_safe, run)
