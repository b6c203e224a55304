"""The car in crosswind: accelerations, comfort index, and the weighting that both layers are judged by."""

from typing import Final

import numpy as np

from astb_studies.paper.checks.criteria import listed
from astb_studies.paper.claims import CheckOutcome, Claim
from astb_studies.paper.comfort import weighting
from astb_studies.paper.experiments import WIND_SPEEDS, paper_ride, plant_ride, upper_sway
from astb_studies.paper.subject import LOADS, Subject

_LIMITS: Final = "a_y and N non-decreasing from 10 to 25 m/s, lower for AW3 at every speed, N < 2"
T11: Final = Claim(
    "T11",
    "Acceleration and comfort index rise with the wind, stay comfortable, and are lower under AW3.",
    "the paper, table of accelerations and comfort indices",
)


@T11.on("plant", _LIMITS, shares="ride")
def ride_on_the_plant(subject: Subject) -> CheckOutcome:
    """Accelerations and comfort indices of the car on the plant's springs."""
    cells = plant_ride(subject)
    a = {key: cell.estimate("acceleration").mean for key, cell in cells.items()}
    index = {key: cell.estimate("weighted", 6.0).mean for key, cell in cells.items()}
    sample = "Quick: one realisation" if subject.quick else "Ten realisations"
    return _ride(a, index, f"{sample} of the wind. {what_the_bar_does(subject)}")


@T11.on("paper", _LIMITS, shares="paper ride")
def ride_of_the_paper(subject: Subject) -> CheckOutcome:
    """Accelerations and comfort indices by equation (28)."""
    table = paper_ride(subject)
    note = "Equation (28) with one degree of freedom, ten realisations of the wind."
    return _ride({k: v[0] for k, v in table.items()}, {k: v[1] for k, v in table.items()}, note)


def _ride(
    a: dict[tuple[str, float], float], index: dict[tuple[str, float], float], note: str
) -> CheckOutcome:
    rows = {case: np.array([a[case, speed] for speed in WIND_SPEEDS]) for case in LOADS}
    judged = comfort_index(index, "")
    grows = all(bool(np.all(np.diff(row) >= 0.0)) for row in rows.values())
    lower = bool(np.all(rows["AW3"] < rows["AW0"]))
    accelerations = "; ".join(f"{case} {listed(row, '.3f')}" for case, row in rows.items())
    return CheckOutcome(
        f"a_y rms {accelerations} m/s²; N {judged.text}",
        judged.holds and grows and lower,
        judged.numbers | {f"a_{case}_{speed:g}": float(one) for (case, speed), one in a.items()},
        note,
    )


A27: Final = Claim("A27", "Comfort index N = 6 a_YP95 in crosswind", "claim T11 of the paper; ENV 12299")


@A27.on("plant", "non-decreasing from 10 to 25 m/s, N(AW3) < N(AW0), N < 2", shares="ride")
def comfort(subject: Subject) -> CheckOutcome:
    """Comfort indices of the car on the plant's springs."""
    cells = plant_ride(subject)
    index = {key: cell.estimate("weighted", 6.0).mean for key, cell in cells.items()}
    width = 0.0 if subject.quick else max(c.estimate("weighted", 6.0).half_width for c in cells.values())
    contact = {load: cells[load, WIND_SPEEDS[-1]].estimate("bump_stop_time").mean for load in LOADS}
    sample = (
        "quick: one realisation" if subject.quick else f"ten realisations, ±{width:.2f} at the most (95 %)"
    )
    return comfort_index(
        index,
        f"At the floor, {sample}. {what_the_bar_does(subject)} At 25 m/s the bump stop is touched"
        f" {100 * contact['AW0']:.0f} % (AW0) and {100 * contact['AW3']:.0f} % (AW3) of the time.",
    )


def what_the_bar_does(subject: Subject) -> str:
    """Return the frequency of the sway mode that the track excites, with and without the car's anti-roll bar."""
    car = subject.vehicle.record

    def sway(**changes: float) -> str:
        modes = {load: upper_sway(subject, load, **changes) for load in LOADS}
        return " and ".join(f"{one.frequency:.2f} Hz ({load})" for load, one in modes.items())

    return (
        f"The anti-roll bar has {float(car.anti_roll_stiffness) / 1e3:.0f} kN·m/rad. The track's"
        f" {float(car.train_speed / car.track_wavelength):.1f} Hz are met by an upper sway mode of {sway()};"
        f" without a bar it would be {sway(anti_roll_stiffness=0.0)}."
    )


@A27.on("paper", "non-decreasing from 10 to 25 m/s, N(AW3) < N(AW0), N < 2", shares="paper ride")
def paper_comfort(subject: Subject) -> CheckOutcome:
    """Comfort indices by equation (28)."""
    index = {key: N for key, (_, N) in paper_ride(subject).items()}
    return comfort_index(
        index, "One lateral degree of freedom (28), emergency spring in series, ten realisations."
    )


def comfort_index(index: dict[tuple[str, float], float], note: str) -> CheckOutcome:
    """Judge a table of N = 6 a_YP95 by load case and wind speed."""
    rows = {load: np.array([index[load, speed] for speed in WIND_SPEEDS]) for load in LOADS}
    grows = {load: bool(np.all(np.diff(row) >= 0.0)) for load, row in rows.items()}
    better = bool(np.all(rows["AW3"] < rows["AW0"]))
    good = bool(max(row.max() for row in rows.values()) < 2.0)
    failing = [f"not non-decreasing for {load}" for load, grows_ in grows.items() if not grows_]
    if not better:
        failing.append("AW3 is not better than AW0 at every speed")
    if not good:
        failing.append("beyond 2")
    return CheckOutcome(
        "; ".join(f"{load} {listed(row, '.2f')}" for load, row in rows.items())
        + " at 10 / 15 / 20 / 25 m/s"
        + "".join(f"; {one}" for one in failing),
        all(grows.values()) and better and good,
        {f"N_{load}_{speed:g}": float(N) for (load, speed), N in index.items()},
        note,
    )


@Claim("A26", "Gains of W_d at 0.5, 1, 2, 4, 8, 16 Hz", "ISO 2631-1, table of W_d").on(
    "both", "ISO 2631-1 ±1 %"
)
def weighting_gains(subject: Subject) -> CheckOutcome:
    """Gains of the filter W_d, from its exact frequency response."""
    f = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0])
    standard = np.array([0.853, 1.011, 0.890, 0.512, 0.253, 0.125])
    gains = np.abs(weighting(f))
    worst = float(np.abs(gains / standard - 1.0).max())
    return CheckOutcome(
        f"{listed(gains, '.3f')} at {listed(f, 'g')} Hz, within {100 * worst:.2f} %",
        worst < 0.01,
        {"deviation": worst} | {f"gain_{one:g}Hz": float(g) for one, g in zip(f, gains, strict=True)},
        "The filter belongs to neither layer: both are judged by it.",
    )
