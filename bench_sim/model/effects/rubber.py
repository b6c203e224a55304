"""Effects of the rubber: more viscosity, friction or creep than the model has.

Each comment has the equation of its effect in the notation of the model.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.effects.effect import Effect, EffectParameter, free_slots


def add_branch(par: Any, ratio: float, time: float) -> None:
    """Add a Maxwell branch with the stiffness ``ratio`` · k_sh and the time constant ``time`` s, unless the ratio is
    0.
    """
    if ratio != 0.0:
        slot = free_slots(par.extra_branch_ratio, 1, "extra Maxwell branches")
        par.extra_branch_ratio[slot] = ratio
        par.extra_branch_time[slot] = time


def _maxwell(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_branch(par, values["ratio"], values["time"])


def _maxwell_two(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_branch(par, values["ratio"] * values["share"], values["time_fast"])
    add_branch(par, values["ratio"] * (1.0 - values["share"]), values["time_slow"])


_PAIRS = ((0.01, 0.1), (0.03, 0.3), (0.1, 1.0), (0.3, 3.0), (1.0, 10.0), (0.03, 3.0))

#: Time constants of the branches in s.
TIMES: Final = np.geomspace(1.5e-3, 400.0, 6)

_UNIT: Final = 2.0 * np.pi

_OMEGA: Final = _UNIT * np.geomspace(0.003, 30.0, 81)

_BRANCHES: Final = 1j * _OMEGA[:, None] * TIMES / (1.0 + 1j * _OMEGA[:, None] * TIMES)


def ladder(order: float) -> NDArray[np.float64]:
    """Return the relative stiffnesses (6,) of the branches whose sum approximates (iω/ω₀)^``order``."""
    wanted = (1j * _OMEGA / _UNIT) ** order
    left = _BRANCHES / np.abs(wanted)[:, None]
    right = wanted / np.abs(wanted)
    both = np.concatenate([left.real, left.imag]), np.concatenate([right.real, right.imag])
    return np.linalg.lstsq(*both, rcond=None)[0]


def _fractional(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    for stiffness, time in zip(ladder(values["order"]), TIMES, strict=True):
        add_branch(par, values["ratio"] * float(stiffness), float(time))


def add_friction(par: Any, force: float, travel: float) -> None:
    """Add a Berg friction element with a limit of ``force`` N and x_2 = ``travel`` m, unless the force is 0."""
    if force != 0.0:
        slot = free_slots(par.extra_friction, 1, "extra friction elements")
        par.extra_friction[slot] = force
        par.extra_friction_travel[slot] = travel


def _friction(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_friction(par, values["force"], values["travel"])


def _friction_distributed(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_friction(par, values["force"] * values["share"], values["travel_short"])
    add_friction(par, values["force"] * (1.0 - values["share"]), values["travel_long"])


def _creep(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    if values["ratio"] != 0.0:
        par.creep_ratio[:] += values["ratio"]
        par.creep_time[:] = values["time"]


def _bump_stop(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    if values["stiffness"] != 0.0:
        par.extra_stop_stiffness += values["stiffness"]
        par.extra_stop_gap = values["gap"]


EFFECTS: Final = (
    # A relaxation of the rubber that is not in the model's branches: one more Maxwell branch in the shell.
    #
    #     F = r k_sh q,   dq/dt = dx/dt − q/τ,   K(iω) = r k_sh iωτ/(1 + iωτ)
    #
    # vertical and lateral, in both springs, x being the bellows' displacement. Its loss per cycle at a given
    # amplitude has one peak, at ω = 1/τ; the pressure has no effect. Source: generalised Maxwell model of
    # filled rubber, e.g. Lion & Kardelky, Int. J. Plasticity 20 (2004); sizes assumed.
    Effect(
        name="maxwell",
        family="rubber",
        title="Maxwell branch of the rubber",
        plain="the rubber relaxes like a Maxwell branch with a ratio to the shell stiffness",
        amplitude=EffectParameter("ratio", "1", "1", 1.0, nominal=0.0, typical=0.3, low=0.0, high=5.0),
        change=_maxwell,
        shapes=(
            EffectParameter(
                "time", "s", "s", 1.0, nominal=0.3, typical=0.3, low=0.005, high=30.0, logarithmic=True
            ),
        ),
        grid=tuple((tau,) for tau in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)),
        touches=frozenset({"force"}),
        confusers=("friction", "fractional", "force_lag"),
        richer=("maxwell_two", "fractional"),
        phenomenon="relaxation of the rubber",
        equation=(
            "F = r k_sh q, dq/dt = dx/dt − q/τ\n"
            "F: force of the branch (N); r: ratio; k_sh: stiffness of the shell (N/m); x: displacement of the "
            "bellows, q: deflection of the branch (m); t: time, τ: time constant (s)"
        ),
        source="generalised Maxwell model of filled rubber (Lion & Kardelky 2004); sizes assumed",
        separated_by="one amplitude at several frequencies, hold after a step: maximum loss at 1/(2π · time constant)",
    ),
    # Two relaxations of the rubber that are not in the model's branches.
    #
    #     K(iω) = r k_sh (s iωτ₁/(1 + iωτ₁) + (1−s) iωτ₂/(1 + iωτ₂))
    #
    # as the effect `maxwell`, which it contains with a share s of one. Source: as there; sizes assumed.
    Effect(
        name="maxwell_two",
        family="rubber",
        title="two Maxwell branches of the rubber",
        plain="the rubber relaxes like two Maxwell branches with a ratio to the shell stiffness",
        amplitude=EffectParameter("ratio", "1", "1", 1.0, nominal=0.0, typical=0.5, low=0.0, high=5.0),
        change=_maxwell_two,
        shapes=(
            EffectParameter(
                "time_fast", "s", "s", 1.0, nominal=0.1, typical=0.1, low=0.005, high=30.0, logarithmic=True
            ),
            EffectParameter(
                "time_slow", "s", "s", 1.0, nominal=1.0, typical=1.0, low=0.005, high=30.0, logarithmic=True
            ),
            EffectParameter("share", "1", "1", 1.0, nominal=0.5, typical=0.5, low=0.0, high=1.0),
        ),
        grid=tuple((fast, slow, 0.5) for fast, slow in _PAIRS),
        touches=frozenset({"force"}),
        confusers=("friction", "maxwell", "fractional"),
        phenomenon="relaxation of the rubber",
        equation=(
            "F = r k_sh (s q₁ + (1−s) q₂), dq_j/dt = dx/dt − q_j/τ_j\n"
            "F: force of both branches (N); r: ratio; k_sh: stiffness of the shell (N/m); x: displacement of the "
            "bellows, q_j: deflections q₁ and q₂ of the branches (m); s: share of the first branch; t: time, τ_j: time "
            "constants (s)"
        ),
        source="generalised Maxwell model of filled rubber (Lion & Kardelky 2004); sizes assumed",
        separated_by="one amplitude from 0.05 to 10 Hz, and hold after a step: two maxima of the loss",
    ),
    # Rubber that follows a power law of the frequency: a fractional Kelvin-Voigt element in the shell.
    #
    #     K(iω) = r k_sh (iω/ω₀)^α,   ω₀ = 2π · 1 Hz
    #
    # realised by six Maxwell branches with time constants from 1.5 ms to 400 s in equal ratios, whose stiffnesses
    # are the least-squares fit of (iω/ω₀)^α, relative to its size, from 0.003 to 30 Hz: smooth in α, within 7 %
    # anywhere and 4 % in the mean square for α from 0.1 to 0.7. Slower than that it relaxes. Source: Bagley &
    # Torvik, AIAA J. 21 (1983); Sjöberg & Kari, Nonlinear Dyn. 33 (2003) for rubber isolators; sizes assumed.
    Effect(
        name="fractional",
        family="rubber",
        title="fractional Kelvin-Voigt rubber",
        plain="the rubber is viscoelastic like a fractional Kelvin-Voigt element with a ratio to the shell stiffness",
        amplitude=EffectParameter("ratio", "1", "1", 1.0, nominal=0.0, typical=0.3, low=0.0, high=5.0),
        change=_fractional,
        shapes=(EffectParameter("order", "1", "1", 1.0, nominal=0.3, typical=0.3, low=0.1, high=0.7),),
        grid=((0.15,), (0.3,), (0.5,), (0.7,)),
        touches=frozenset({"force"}),
        confusers=("maxwell", "maxwell_two", "friction"),
        phenomenon="relaxation of the rubber",
        equation=(
            "K(iω) = r k_sh (iω/ω₀)^α\n"
            "K: dynamic stiffness (N/m); r: ratio; k_sh: stiffness of the shell (N/m); ω: angular frequency, ω₀ = "
            "2π·1 Hz (rad/s); α: order; i: imaginary unit"
        ),
        source="Bagley & Torvik 1983; Sjöberg & Kari 2003; sizes assumed",
        separated_by="one amplitude from 0.05 to 10 Hz: stiffness and loss rise with the same power of the frequency",
    ),
    # Friction in the rubber beyond the spring's own: one more Berg element.
    #
    #     F = F_s + (x − x_s)/(x_2 (1 − α) + (x − x_s)) · (F_max − F_s),   x > x_s, and the same with the signs turned
    #
    # in both directions of both springs; x is the bellows' displacement, α = F_s/F_max at the last reversal. It
    # turns where the spring's own friction turns. Its loop does not depend on the rate; loss per cycle, large
    # against x_2: 4 F_max x_0. Source: Berg, Veh. Syst. Dyn. 30 (1998) 197; sizes assumed.
    Effect(
        name="friction",
        family="rubber",
        title="Berg friction of the rubber",
        plain="the rubber has Berg friction",
        amplitude=EffectParameter("force", "N", "N", 1.0, nominal=0.0, typical=200.0, low=0.0, high=1e4),
        change=_friction,
        shapes=(
            EffectParameter(
                "travel", "m", "mm", 1e-3, nominal=3e-3, typical=3e-3, low=1e-4, high=0.03, logarithmic=True
            ),
        ),
        grid=((0.5e-3,), (1.5e-3,), (5e-3,), (15e-3,)),
        touches=frozenset({"force"}),
        confusers=("maxwell", "fractional", "force_lag"),
        richer=("friction_distributed",),
        phenomenon="friction of the rubber",
        equation=(
            "F = F_s + (x−x_s)/(x_2(1−α) + x−x_s) · (F_max−F_s)\n"
            "F: friction force, F_s: its value at the last reversal, F_max: its limit (N); x: displacement, x_s: "
            "its value at the last reversal, x_2: travel (m); α = F_s/F_max"
        ),
        source="Berg 1998; sizes assumed",
        separated_by="quasi-static loop at two speeds (same width), and one frequency at several amplitudes",
    ),
    # Friction in the rubber that gives way in two stages: two Berg elements with different travels.
    #
    #     F = s F_max f(x; x_2,a) + (1−s) F_max f(x; x_2,b)
    #
    # f as in the effect `friction`, which it contains with a share s of one. The two elements stand
    # for the spread of sliding limits that a bank of Jenkins elements has. Source: Iwan, J. Appl. Mech. 33 (1966)
    # 893; Berg 1998; sizes assumed.
    Effect(
        name="friction_distributed",
        family="rubber",
        title="distributed friction of the rubber",
        plain="the rubber has distributed friction",
        amplitude=EffectParameter("force", "N", "N", 1.0, nominal=0.0, typical=300.0, low=0.0, high=1e4),
        change=_friction_distributed,
        shapes=(
            EffectParameter(
                "travel_short",
                "m",
                "mm",
                1e-3,
                nominal=1e-3,
                typical=1e-3,
                low=1e-4,
                high=0.03,
                logarithmic=True,
            ),
            EffectParameter(
                "travel_long",
                "m",
                "mm",
                1e-3,
                nominal=8e-3,
                typical=8e-3,
                low=1e-4,
                high=0.03,
                logarithmic=True,
            ),
            EffectParameter("share", "1", "1", 1.0, nominal=0.5, typical=0.5, low=0.0, high=1.0),
        ),
        grid=((0.3e-3, 3e-3, 0.5), (1e-3, 8e-3, 0.5), (2e-3, 20e-3, 0.5)),
        touches=frozenset({"force"}),
        confusers=("friction", "maxwell", "fractional"),
        phenomenon="friction of the rubber",
        equation=(
            "F = F_max (s f(x; x_2,a) + (1−s) f(x; x_2,b))\n"
            "F: friction force, F_max: its limit (N); f: relative force of a Berg element; x: displacement, "
            "x_2,a, x_2,b: short and long travel (m); s: share of the first element"
        ),
        source="Iwan 1966, Berg 1998; sizes assumed",
        separated_by="one frequency at amplitudes from 0.2 to 20 mm",
    ),
    # The emergency spring creeps under the load that it carries.
    #
    #     ζ = ζ_b − (F_z − P)/k_z − q,   dq/dt = (r F_z/k_z − q)/τ
    #
    # a Kelvin element in series with each emergency spring, of r times its elastic compliance. It has not yet crept
    # when the simulation begins: a load that has stood for longer shows a smaller r. A replay gets as input how far it
    # has crept where it begins. Height at constant pressure and mass, or pressure at constant height, drift by an
    # exponential that ends. Source: creep of layered rubber, some percent of the deflection per decade of time
    # (Freakley & Payne, Theory and Practice of Engineering with Rubber, 1978); sizes assumed.
    Effect(
        name="creep",
        family="rubber",
        title="creep of the emergency spring",
        plain="the emergency springs creep",
        amplitude=EffectParameter("ratio", "1", "%", 0.01, nominal=0.0, typical=0.05, low=0.0, high=1.0),
        change=_creep,
        shapes=(
            EffectParameter(
                "time", "s", "s", 1.0, nominal=100.0, typical=100.0, low=5.0, high=1e4, logarithmic=True
            ),
        ),
        grid=((10.0,), (30.0,), (100.0,), (300.0,), (1000.0,)),
        touches=frozenset({"force", "gas"}),
        confusers=("leak", "leak_laminar", "heat", "pressure_drift"),
        equation=(
            "ζ = ζ_b − (F_z−P)/k_z − q, dq/dt = (r F_z/k_z − q)/τ\n"
            "ζ, ζ_b: height of the complete spring and of its bellows, q: creep (m); F_z: vertical force, P: "
            "preload (N); k_z: stiffness of the emergency spring (N/m); r: ratio; t: time, τ: time constant (s)"
        ),
        source="creep of layered rubber (Freakley & Payne 1978); sizes assumed",
        separated_by="hold at AW3 for several minutes: the mass pV/(RT) stays while force and pressure drift together",
    ),
    # A lateral stop that is not in the model: linear beyond a gap.
    #
    #     F_y = −k max(|y| − g, 0) sign(y),   y = y_B − y_P
    #
    # on the bolster (or the car body), at the height of the lateral bump stop, next to it. Linear in k, so that a small
    # stop leaves a small trace; none where the gap is not used up. Source: geometry; sizes assumed.
    Effect(
        name="bump_stop",
        family="rubber",
        title="lateral bump stop",
        plain="the bolster hits a lateral bump stop",
        amplitude=EffectParameter(
            "stiffness", "N/m", "kN/m", 1e3, nominal=0.0, typical=1e5, low=0.0, high=1e7
        ),
        change=_bump_stop,
        shapes=(EffectParameter("gap", "m", "mm", 1e-3, nominal=10e-3, typical=10e-3, low=0.0, high=60e-3),),
        grid=((4e-3,), (8e-3,), (12e-3,), (16e-3,), (22e-3,)),
        touches=frozenset({"force"}),
        confusers=("friction", "area_slope"),
        equation=(
            "F_y = −k max(|y|−g, 0) sign y\n"
            "F_y: lateral force (N); k: stiffness (N/m); y: lateral displacement, g: gap (m)"
        ),
        source="geometry; sizes assumed",
        separated_by="slow lateral sine of growing amplitude: a knee in F_y(y), third harmonic, no loss",
    ),
)
