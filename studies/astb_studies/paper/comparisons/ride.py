"""The paper's table: acceleration and comfort index over the wind speed."""

from math import isnan, nan

from astb_studies.paper.checks.ride import T11
from astb_studies.paper.claims import BenchOutcome
from astb_studies.paper.combined import RIDE_WINDS, ride_name
from astb_studies.paper.comparisons.comparison import entry_of
from astb_studies.paper.hybrid.floor import COMFORT, COMFORTABLE, SHAKES
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS

#: The car whose rides are next to those that decide.
_BARE = "no anti-roll bar"


@T11.on_the_bench("comfort")
def comfort(study: Study) -> BenchOutcome:
    """Compare rides of a car on the bench's springs with rides on the plant's springs."""
    plant = entry_of(study, "T11", "plant")
    shakes, index = (
        {
            (load, wind): _ride_result(study, ride_name(load, wind), check)
            for load in LOADS
            for wind in RIDE_WINDS
        }
        for check in (SHAKES, COMFORT)
    )
    weak, strong = RIDE_WINDS
    text = "; ".join(
        f"{load} "
        + ", ".join(f"{shakes[load, wind]:.3f} m/s²{_index(index[load, wind])}" for wind in RIDE_WINDS)
        for load in LOADS
    )
    rises = all(shakes[load, strong] >= shakes[load, weak] for load in LOADS)
    lower = all(shakes["AW3", wind] < shakes["AW0", wind] for wind in RIDE_WINDS)
    comfortable = not any(N >= COMFORTABLE for N in index.values())
    bare = {
        load: ", ".join(
            f"{one.comfort:.2f} at {one.wind_speed:g} m/s"
            for one in study.rides
            if (one.layer, one.load) == (_BARE, load)
        )
        for load in LOADS
    }
    return BenchOutcome(
        f"plan ride, a_y rms at {weak:g} and {strong:g} m/s: {text}",
        rises and lower and comfortable,
        f"car on the plant's springs: {plant['measured']}. {plant['note']}"
        f" Without it N is {bare['AW0']} (AW0) and {bare['AW3']} (AW3).",
    )


def _ride_result(study: Study, name: str, check: str) -> float:
    """Return the result of a ride for a check (SI); NaN if the ride was too short."""
    values = (one.value for one in study.bench.rides[name].checks if one.name == check)
    return next((value for value in values if value is not None), nan)


def _index(N: float) -> str:
    return "" if isnan(N) else f" (N {N:.2f})"
