"""The comparisons by figure."""

from typing import Final

from paper_study.comparisons.area import area
from paper_study.comparisons.displacement import displacement
from paper_study.comparisons.frequency import frequency
from paper_study.comparisons.pressure import pressure
from paper_study.comparisons.ride import comfort
from paper_study.comparisons.roll import roll
from paper_study.comparisons.track import track
from paper_study.comparisons.validation import validation

COMPARISONS: Final = {
    "figure-05": track,
    "figure-06": pressure,
    "figure-07": area,
    "figure-08": validation,
    "figure-09": displacement,
    "figure-10": roll,
    "figure-11": frequency,
    "comfort": comfort,
}
