"""The reference state of ISO 6358, to which sonic conductances refer."""

from typing import Final

#: Density in kg/m³ (humid air, 1 bar) and temperature in K.
ISO_DENSITY: Final = 1.185
ISO_TEMPERATURE: Final = 293.15
