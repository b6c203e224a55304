"""The paper's table: acceleration and comfort index over the wind speed."""

from paper_study.comparisons.comparison import ClaimComparison, closed_form_of, entry_of
from paper_study.study import Study
from paper_study.subject import LOADS

#: The car whose rides stand beside those that decide.
_BARE = "no anti-roll bar"


def comfort(study: Study) -> list[ClaimComparison]:
    """Return what the plant and equation (28) say to the claim of the table."""
    plant, (text, holds) = entry_of(study, "T11", "plant"), closed_form_of(study, "T11")
    bare = {
        load: ", ".join(f"{one.comfort:.2f}" for one in study.rides if (one.layer, one.load) == (_BARE, load))
        for load in LOADS
    }
    return [
        ClaimComparison(
            "T11",
            "Acceleration and comfort index rise with the wind, stay comfortable, and are lower under AW3.",
            "car on the plant's springs: " + plant["measured"],
            text,
            f"{plant['note']} Without it N is {bare['AW0']} (AW0) and {bare['AW3']} (AW3).",
            plant["holds"],
            holds,
            "plant",
        )
    ]
