"""Effects of the rig: actuators, frame, platform and load cells.

Each comment has the equation of its effect in the notation of the model.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, ShownBy, adds, scales


def _frame_compliance(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.frame_stiffness /= 1.0 + values["compliance"] * par.frame_stiffness


_STATICS: Final = "balance of forces and moments on the platform"


def _emergency_compliance(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.emergency_stiffness_vertical /= 1.0 + values["error"]
    par.emergency_stiffness_lateral /= 1.0 + values["error"]


EFFECTS: Final = (
    # Actuator tracking: the actuators follow their commands with another natural frequency, ω = (1+e) ω₀.
    #
    # A replay uses the measured motion of the actuators and not their commands, so it cannot show
    # this.
    Effect(
        name="actuator_tracking",
        family="rig",
        title="actuators follow faster or slower than assumed",
        plain="the actuators follow faster or slower than assumed",
        amplitude=EffectParameter("error", "1", "%", 0.01, nominal=0.0, typical=-0.3, low=-0.8, high=1.0),
        change=scales("actuator_frequency", "error"),
        touches=frozenset({"timing"}),
        confusers=("frame_compliance",),
        equation=(
            "q̈ = ω² (q_set − q) − 2ζω q̇,  ω = (1+e) ω₀\n"
            "q: displacement of the actuator, q_set: its set-point (m); ω₀, ω: assumed and actual natural "
            "frequency (rad/s); ζ: damping ratio; e: error"
        ),
        source="servo valve and supply pressure set the bandwidth",
        separated_by="command against displacement in a sweep",
        shown_by=ShownBy.COMMANDS,
    ),
    # Frame compliance: frame and oil give way more than assumed, 1/k = 1/k₀ + c: piston minus bolster grows by c F.
    Effect(
        name="frame_compliance",
        family="rig",
        title="frame is softer than assumed",
        plain="the frame is softer than assumed",
        amplitude=EffectParameter(
            "compliance", "m/N", "mm/kN", 1e-6, nominal=0.0, typical=1e-8, low=0.0, high=1e-6
        ),
        change=_frame_compliance,
        touches=frozenset({"sensor"}),
        confusers=("emergency_compliance",),
        equation=(
            "d_piston − d_bolster = (1/k₀ + c) F\n"
            "d_piston, d_bolster: displacement of piston and bolster (m); F: force (N); k₀: assumed stiffness of "
            "the frame (N/m); c: compliance (m/N)"
        ),
        source="bolted joints, oil column",
        separated_by="comparison of the laser across the spring with the transducer of the actuator",
    ),
    # Platen inertia: the load cells also accelerate what lies on them, F_m = F + m a_P, as the platform moves.
    #
    # The effect is not visible if the rig compensates it, or if the platform does not move.
    Effect(
        name="platen_inertia",
        family="rig",
        title="load cells measure the platform's inertia",
        plain="the load cells measure the platform's inertia",
        amplitude=EffectParameter("mass", "kg", "kg", 1.0, nominal=0.0, typical=100.0, low=0.0, high=2000.0),
        change=adds("platen_mass", "mass"),
        touches=frozenset({"sensor"}),
        confusers=("force_lag", "force_latency"),
        equation=(
            "F_z,m = F_z + m z̈_P,  F_y,m = F_y + m ÿ_P\n"
            "F_z,m, F_y,m: measured, F_z, F_y: true vertical and lateral force (N); m: mass (kg); z̈_P, ÿ_P: "
            "acceleration of the platform (m/s²)"
        ),
        source="Newton",
        separated_by="the platform shaken without spring: force grows with ω²",
    ),
    # Cell loads: how the four upright and the two lateral load cells share what the platform carries.
    #
    # A seat or a load that is not in the middle lengthwise causes a pitching moment. If one of four supports
    # is soft, or is not in the plane of the others, its load is carried by its neighbours: no sum of cells
    # shows that.
    Effect(
        name="seat_offset",
        family="rig",
        title="seat of a spring off the middle, lengthwise",
        plain="the seat of the {side} spring is off the middle, lengthwise",
        amplitude=EffectParameter(
            "ahead", "m", "mm", 1e-3, nominal=0.0, typical=10e-3, low=-50e-3, high=50e-3
        ),
        change=adds("seat_ahead", "ahead"),
        places=PLACES,
        touches=frozenset({"sensor"}),
        confusers=("load_offset",),
        equation=(
            "Σ x_k F_k = x_s F_z,  l_x (F_5 − F_6) = x_s F_y\n"
            "F_k: force of load cell k, F_z, F_y: vertical and lateral force of the spring (N); x_k: lengthwise "
            "position of cell k, x_s: offset of the seat, l_x: lever arm of the lateral cells 5 and 6 (m)"
        ),
        source=_STATICS,
        separated_by="roll and shear: in shear, the lateral load cells differ",
    ),
    Effect(
        name="load_offset",
        family="rig",
        title="vertical actuators off the middle, lengthwise",
        plain="the vertical actuators are off the middle, lengthwise",
        amplitude=EffectParameter(
            "ahead", "m", "mm", 1e-3, nominal=0.0, typical=10e-3, low=-50e-3, high=50e-3
        ),
        change=adds("load_ahead", "ahead"),
        touches=frozenset({"sensor"}),
        confusers=("seat_offset",),
        equation=(
            "Σ x_k F_k = x_l (F_a,L + F_a,R)\n"
            "F_k: force of load cell k, F_a,L, F_a,R: forces of the left and right actuator (N); x_k: lengthwise "
            "position of cell k, x_l: offset of the actuators (m)"
        ),
        source=f"{_STATICS}; a bolster that does not pitch",
        separated_by="roll and shear: in shear, the lateral load cells stay equal",
    ),
    Effect(
        name="soft_support",
        family="rig",
        title="soft support of a load cell",
        plain="the support of load cell {side} is softer than the others",
        amplitude=EffectParameter("softer", "1", "%", 0.01, nominal=0.0, typical=0.2, low=0.0, high=10.0),
        change=adds("support_softness", "softer"),
        places=("1", "2", "3", "4"),
        touches=frozenset({"sensor"}),
        confusers=("twisted_seat",),
        equation=(
            "a = −±_k δ F_k / (4 + δ) on cells 1 and 4, −a on 2 and 3\n"
            "a: change of a cell's force, F_k: force of cell k without the error (N); ±_k: + for cells 1 and 4, − "
            "for 2 and 3; δ: additional compliance, relative to the other supports"
        ),
        source="least energy of a rigid platform on four elastic supports, of which one is 1 + δ times as compliant",
        separated_by="roll or shear, at two load cases: the error grows with the load",
    ),
    Effect(
        name="twisted_seat",
        family="rig",
        title="twisted seat of the platform",
        plain="the seat of the platform on its four supports is twisted",
        amplitude=EffectParameter("force", "N", "N", 1.0, nominal=0.0, typical=1000.0, low=-2e4, high=2e4),
        change=adds("platform_twist", "force"),
        touches=frozenset({"sensor"}),
        confusers=("soft_support", "force_offset"),
        equation=(
            "a = +w on cells 1 and 4, −w on 2 and 3; supports of stiffness k out of plane by s: w = k s / 4\n"
            "a: change of a cell's force, w: force (N); k: stiffness of a support (N/m); s: its distance from the "
            "plane (m)"
        ),
        source=f"{_STATICS}; a rigid platform that is bolted down",
        separated_by="two load cases: the error does not grow with the load",
    ),
    # Coupling: the spring's roll couples more or less with its lateral force than assumed, K_yφ = (1+e) K_yφ,0.
    Effect(
        name="coupling",
        family="rig",
        title="lateral-roll coupling differs from the assumed one",
        plain="the coupling between shear and roll is not the assumed one",
        amplitude=EffectParameter("error", "1", "%", 0.01, nominal=0.0, typical=0.3, low=-1.0, high=2.0),
        change=scales("coupling_sign", "error"),
        touches=frozenset({"force"}),
        confusers=("crosstalk",),
        equation=(
            "F_y −= σ K_yφ φ_s tanh(θ/φ_s),  M −= σ K_yφ y sech²(θ/φ_s)\n"
            "F_y: lateral force (N); M: roll moment (N·m); σ: factor of the coupling, which the error changes; "
            "K_yφ: coupling stiffness (N/rad); θ: roll angle, φ_s: its saturation (rad); y: lateral displacement "
            "(m)"
        ),
        source="Facchinetti, Mazzola, Alfi and Bruni 2010: shear and roll of an air spring act on each other",
        separated_by="lateral sweeps at fixed roll angles: the error changes sign with the angle",
    ),
    # Emergency-spring compliance: the rubber stack in series gives way more or less, 1/k = (1+e)/k₀ in both directions.
    Effect(
        name="emergency_compliance",
        family="rig",
        title="emergency springs are softer or harder than assumed",
        plain="the compliance of the emergency springs differs from the assumed one",
        amplitude=EffectParameter("error", "1", "%", 0.01, nominal=0.0, typical=0.3, low=-0.8, high=4.0),
        change=_emergency_compliance,
        touches=frozenset({"force"}),
        confusers=("frame_compliance", "bellows_volume"),
        equation=(
            "ζ_b = ζ + (1+e) (F_z − P)/k₀,  y_b = y + (1+e) F_y/k₀\n"
            "ζ_b, y_b: height and lateral displacement of the bellows, ζ, y: those of the complete spring (m); "
            "F_z, F_y: vertical and lateral force, P: preload (N); k₀: assumed stiffness (N/m); e: error"
        ),
        source="layered rubber; static and dynamic stiffness differ by up to a half",
        separated_by="laser across the spring, at both load cases: it does not measure the frame",
    ),
)
