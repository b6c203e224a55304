"""Signals computed from the outputs of the bench that only one of its subsystems can change."""

from collections.abc import Mapping
from typing import Any, Final

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_protocol.words import SIDES
from bench_sim.parameters import Parameters
from diagnosis.contracts import Array, Experiment

#: Four vertical ones, then two lateral ones.
CELLS: Final = (*BY_GROUP[Group.VERTICAL_LOAD_CELL], *BY_GROUP[Group.LATERAL_LOAD_CELL])


def parity(experiment: Experiment, outputs: Mapping[str, Array], parameters: Parameters) -> dict[str, Array]:
    """Return every parity signal (n,) whose ``outputs`` (n,) were measured.

    The signals are F − p_g A_e(ζ) of a spring, with F from the load cells (`spring_forces`); the mass of its air, (p_b
    V_b/T_b + p_a V_a/T_a)/R; and F/k of an actuator's frame, which is the difference between its transducer and the
    lasers.
    """
    par = parameters.record
    found: dict[str, Array] = {}
    forces = spring_forces(outputs, par) if all(name in outputs for name in CELLS) else ()
    for i, side in enumerate(SIDES):
        height = experiment.inputs[f"{side}.height"]
        bellows, auxiliary = (f"{side}.{chamber}_pressure" for chamber in ("bellows", "auxiliary"))
        slope = par.effective_area_slope[i]
        if forces and bellows in outputs:
            growth = par.effective_area_growth[i] * (outputs[bellows] - par.area_reference_pressure)
            area = par.effective_area[i] + slope * height + growth
            found[f"{side} force less pressure times area, N"] = forces[i] - outputs[bellows] * area
        warm, cold = (f"{side}.{chamber}_temperature" for chamber in ("bellows", "auxiliary"))
        if all(name in outputs for name in (bellows, auxiliary, warm, cold)):
            V = par.bellows_volume[i] + (par.effective_area[i] + 0.5 * slope * height) * height
            content = (outputs[bellows] + par.atmospheric_pressure) * V / outputs[warm]
            content += (
                (outputs[auxiliary] + par.atmospheric_pressure) * par.auxiliary_volume[i] / outputs[cold]
            )
            found[f"{side} mass of air, g"] = 1e3 * content / par.gas_constant
        if (piston := f"vertical_{side}.displacement") in outputs:
            still = 0.0 * height
            platform = experiment.inputs.get("platform.vertical", still)
            roll = experiment.inputs.get("platform.roll", still)
            arm = (1.0 - 2.0 * i) * par.spring_half_spacing
            found[f"{side} actuator less laser, mm"] = 1e3 * (
                outputs[piston] - height - platform - arm * roll
            )
    return found


def spring_forces(outputs: Mapping[str, Array], par: Any) -> tuple[Array, Array]:
    """Return the vertical forces (N) of the left and the right spring, each (n,).

    F_L + F_R = ΣF_k, (F_L − F_R) b = l_y (F_1 + F_3 − F_2 − F_4) + (h − z_c) F_y. The moment of the rubber is small and
    odd in the roll; it counts as a difference of forces.
    """
    one, two, three, four, five, six = (outputs[name] for name in CELLS)
    total = one + two + three + four
    moment = par.load_cell_y * (one + three - two - four)
    moment = moment + (par.column_height - par.load_cell_height) * (five + six)
    difference = moment / par.spring_half_spacing
    return 0.5 * (total + difference), 0.5 * (total - difference)
