"""Results of the bench for the paper's claims, with a file for each figure."""

from astb_studies.paper.comparisons import (
    area,
    displacement,
    frequency,
    pressure,
    ride,
    roll,
    track,
    validation,
)

__all__ = ["area", "displacement", "frequency", "pressure", "ride", "roll", "track", "validation"]
