"""The keys of ``[fmu]`` in a map: uncertain numbers of an FMU, possible causes of its deviation, and its inputs and
steps.
"""

from __future__ import annotations

from typing import Literal

import msgspec


class BaseKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.base.NAME]``: a number that differs between specimens, ``value`` ± ``spread`` (one standard deviation).

    Without ``value`` the value of the FMU is used. Without ``spread`` the prior is uniform from ``low`` to ``high``.
    ``per_run``: each record has its own value, such as a state at its start.
    """

    spread: str | None = None
    value: str | None = None
    low: str | None = None
    high: str | None = None
    logarithmic: bool = False
    per_run: bool = False


class ShapeKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.effects.NAME.shapes.VARIABLE]``: a variable that matters only while the effect is present."""

    tried: list[str]
    low: str | None = None
    high: str | None = None
    logarithmic: bool = False


class EffectKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.effects.NAME]``: an effect that a ``variable`` controls. At the value ``off`` the effect is missing;
    ``typical`` is its usual size.
    """

    variable: str
    typical: str
    off: str | None = None
    low: str | None = None
    high: str | None = None
    title: str = ""
    family: str = "model"
    says: str = ""
    equation: str = ""
    confusers: list[str] = []
    phenomenon: str = ""
    shapes: dict[str, ShapeKeys] = {}


class SurfaceKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[[fmu.surfaces]]``: an unknown term that is added to the input or output ``signal``. It depends on the two
    signals in ``over``, given with their ranges.
    """

    signal: str
    over: dict[str, tuple[str, str]]
    typical: str
    knots: int = 5


class MeasuredKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.measured.SIGNAL]``: typical errors of a measured signal, and which measurement errors are tested as
    causes.
    """

    offset: str | None = None
    delay: str | None = None
    causes: list[Literal["gain", "offset", "drift", "lag", "latency", "held"]] | None = None


class FmuKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu]`` as a whole."""

    parameters: str | None = None  #: parameter set (SSV), next to the map, that replaces values of the FMU
    base: dict[str, BaseKeys] = {}
    effects: dict[str, EffectKeys] = {}
    surfaces: list[SurfaceKeys] = []
    measured: dict[str, MeasuredKeys] = {}
    gauge: list[str] = []  #: gauge pressures; the others are absolute
    step: str | None = None  #: communication step; else the step of the grid
    settle: str | None = None  #: time for which inputs are held before a record begins
    hold: Literal["middle", "begin", "end"] = "middle"  #: time within a step of which inputs are taken
    patience: str = "60 s"  #: timeout without progress
