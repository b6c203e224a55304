"""Figure 5: the track's excitation, as the platform of the bench follows it."""

from typing import Final

import numpy as np

from astb_studies.paper.claims import BenchOutcome, Claim
from astb_studies.paper.closed_form import unilateral_cosine
from astb_studies.paper.study import Study
from astb_studies.paper.sweeps.frequency import SWEEP_AMPLITUDE
from astb_studies.paper.sweeps.ratio import NATURAL
from bench_protocol.arrays import Floats
from bench_protocol.units import mm, ms

TRACK: Final = Claim(
    "",
    "The track lifts the platform by a one-sided cosine, in proportion to its amplitude.",
    "the paper, figure 5 and equation (24)",
)


@TRACK.on_the_bench("figure-05")
def track(study: Study) -> BenchOutcome:
    """Deviation of the platform from the track, corrected for the lag."""
    times, platform = study.bench.track

    def expected(late: float) -> Floats:
        return np.asarray(unilateral_cosine(times - late, SWEEP_AMPLITUDE, 2 * np.pi * NATURAL, 3))

    lags = np.arange(0.0, 60.0, 0.5) * ms
    lag = float(min(lags, key=lambda late: float(np.sum((platform - expected(late)) ** 2))))
    off = float(np.sqrt(np.mean((platform - expected(lag)) ** 2)))
    return BenchOutcome(
        f"5 mm at 1.2 Hz: the platform peaks at {platform.max() / mm:.2f} mm and runs {lag / ms:.0f} ms behind",
        off < 0.02 * SWEEP_AMPLITUDE,
        f"{off / mm:.2f} mm rms once the lag is taken off",
        ("z = (a/2)(1 − cos ωt) (24); its sine has half of the amplitude", True),
    )
