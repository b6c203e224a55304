"""Figure 8: deviation of the models from the bench's curves, and the possible causes of the damping deviation."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from astb_studies.paper.claims import BenchOutcome, Claim
from astb_studies.paper.closed_form import amplitude_damping
from astb_studies.paper.comparisons.comparison import entry_of, largest_deviation, percent
from astb_studies.paper.laws import closed_stiffness, fitted_lateral_area
from astb_studies.paper.plans.damping_ratio import PLATES
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS, Subject
from astb_studies.paper.sweeps.frequency import SWEEP_AMPLITUDE
from astb_studies.paper.sweeps.pressure import AMPLITUDES
from astb_studies.paper.sweeps.ratio import NATURAL
from bench_protocol.arrays import Floats
from bench_protocol.units import mm


@dataclass(frozen=True, slots=True)
class Deviation:
    """Deviation of the models from one curve of the bench, as shares of the measured value; nan where there is none.

    ``model_worst`` is the largest, with its sign; the others are root mean squares.
    """

    panel: str
    curve: str
    model: float
    model_worst: float
    without_rubber: float
    closed: float


AGREES: Final = Claim(
    "", "The model agrees with the experiment in lateral stiffness.", "the paper, figure 8(a) and (b)"
)


@AGREES.on_the_bench("figure-08")
def lateral_stiffness(study: Study) -> BenchOutcome:
    """Deviation of the plant's model and of the closed form from the bench's lateral stiffness."""
    rows = [row for row in deviations(study) if row.panel in "ab"]
    model = max(row.model for row in rows)
    closed = max(row.closed for row in rows if not np.isnan(row.closed))
    return BenchOutcome(
        f"plant with identified parameters: within {100 * model:.1f} % rms on every curve",
        model < 0.03,
        f"fitted area A_L0 = {fitted_lateral_area(study.bench):.4f} m²",
        (
            f"(10) with its area fitted to the bench: {100 * closed:.0f} % rms; one line for all amplitudes",
            closed < 0.05,
        ),
        "plant",
    )


DEVIATES: Final = Claim(
    "",
    "Damping deviates by about 5 %, because the model leaves the rubber's out.",
    "the paper, figure 8(c)",
)


@DEVIATES.on_the_bench("figure-08")
def damping(study: Study) -> BenchOutcome:
    """Excess of the bench's damping over that of the orifice alone, and the contribution of the plant's rubber."""
    (thirteen,) = (row for row in deviations(study) if row.curve == "13 mm orifice")
    at = study.bench.points("damping_ratio", "Vertical damping c over amplitude, AW0", "13 mm", first=True)
    place = int(np.argmin(np.abs(at.x - SWEEP_AMPLITUDE)))
    c = study.model["damping 13 mm"]
    omega = 2 * np.pi * NATURAL
    orifice = float(c["orifice"].imag[place] / omega)
    more, modelled = float(at.y[place]) / orifice - 1.0, float(c["K"].imag[place] / omega) / orifice - 1.0
    return BenchOutcome(
        f"AW0, 13 mm, 5 mm, 1.2 Hz: {percent(more)} above the orifice alone, of which the model's rubber has"
        f" {percent(modelled)}; without rubber {100 * thirteen.without_rubber:.1f} % rms over all amplitudes",
        0.02 <= more <= 0.08 and abs(more - modelled) < 0.5 * more,
        f"the same share in the plant (A22): {entry_of(study, 'A22', 'plant')['measured']}",
        ("no rubber in (19); see (d) to (f) for what else would look alike", None),
    )


def deviations(study: Study) -> list[Deviation]:
    """Return, for every curve of figure 8, the deviation of the models from the rig that gave the parameters."""
    nan = float("nan")
    rows = []
    fitted = fitted_lateral_area(study.bench)
    omega = 2 * np.pi * NATURAL
    for panel, load in zip("ab", LOADS, strict=True):
        for a, K in zip(sorted(AMPLITUDES), study.model[f"lateral {load}"]["K"], strict=True):
            one = study.bench.lateral_stiffness(load, a, first=True)
            law = closed_stiffness(load, one.x, lateral_area=fitted)
            rows.append(
                Deviation(
                    panel,
                    f"K′, {load}, {a / mm:g} mm",
                    _rms(K.real, one.y),
                    largest_deviation(K.real, one.y),
                    nan,
                    _rms(law, one.y),
                )
            )
    for d in PLATES:
        name = f"{d / mm:g} mm"
        one = study.bench.points("damping_ratio", "Vertical damping c over amplitude, AW0", name, first=True)
        model = study.model[f"damping {name}"]
        whole, bare = model["K"].imag / omega, model["orifice"].imag / omega
        par = Subject().spring("AW0")
        law = np.asarray(amplitude_damping(omega, one.x, d, par.pressure, par))
        rows.append(
            Deviation(
                "c",
                f"{name} orifice",
                _rms(whole, one.y),
                largest_deviation(whole, one.y),
                _rms(bare, one.y),
                _rms(law, one.y),
            )
        )
    for load in LOADS:
        plan = f"frequency_sweep_{load.lower()}"
        c = study.bench.points(plan, "Vertical damping c per spring", f"{load}, orifice", first=True)
        model = study.model[f"vertical {load}, orifice"]
        shown = (c.x >= 0.3) & (c.x <= 10.0)
        with_rubber, bare = ((model[name].imag / (2 * np.pi * c.x))[shown] for name in ("K", "orifice"))
        y = c.y[shown]
        rows.append(
            Deviation(
                "d" if load == "AW0" else "11c",
                f"c, {load}, 0.4 to 10 Hz",
                _rms(with_rubber, y),
                largest_deviation(with_rubber, y),
                _rms(bare, y),
                nan,
            )
        )
    return rows


def _rms(model: Floats, measured: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(model / measured - 1.0))))
