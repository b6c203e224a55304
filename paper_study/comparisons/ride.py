"""The paper's table: acceleration and comfort index over the wind speed."""

from paper_study.comparisons.comparison import ClaimComparison, closed_form_of, entry_of
from paper_study.study import Study


def comfort(study: Study) -> list[ClaimComparison]:
    """Return what the plant and equation (28) say to the claim of the table."""
    plant, (text, holds) = entry_of(study, "T11", "plant"), closed_form_of(study, "T11")
    return [
        ClaimComparison(
            "T11",
            "Acceleration and comfort index rise with the wind, stay comfortable, and are lower under AW3.",
            "car on the plant's springs: " + plant["measured"],
            text,
            plant["note"],
            plant["holds"],
            holds,
            "plant",
        )
    ]
