"""What the bench says to the paper's claims, a file for each figure: each declares itself with its claim."""

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
