"""The paper's table: acceleration and comfort index over the wind speed."""

from astb_studies.paper.checks.ride import T11
from astb_studies.paper.claims import BenchOutcome
from astb_studies.paper.comparisons.comparison import entry_of
from astb_studies.paper.study import Study
from astb_studies.paper.subject import LOADS

#: The car whose rides stand beside those that decide.
_BARE = "no anti-roll bar"


@T11.on_the_bench("comfort")
def comfort(study: Study) -> BenchOutcome:
    """What the plant says: the bench has no car."""
    plant = entry_of(study, "T11", "plant")
    bare = {
        load: ", ".join(
            f"{one.comfort:.2f} at {one.wind_speed:g} m/s"
            for one in study.rides
            if (one.layer, one.load) == (_BARE, load)
        )
        for load in LOADS
    }
    return BenchOutcome(
        "car on the plant's springs: " + plant["measured"],
        plant["holds"],
        f"{plant['note']} Without it N is {bare['AW0']} (AW0) and {bare['AW3']} (AW3).",
        by="plant",
    )
