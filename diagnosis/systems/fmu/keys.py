"""``[fmu]`` of a map: what of an FMU is believed, what may be wrong with it, and how it is driven."""

from __future__ import annotations

from typing import Literal

import msgspec


class BaseKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.base.NAME]``: a number that no two specimens share, ``value`` ± ``spread`` (one standard deviation).

    Without a ``value`` it is that of the FMU. Without a ``spread`` it may be anything from ``low`` to ``high``.
    ``per_run``: each record has its own, such as a state at its start.
    """

    spread: str | None = None
    value: str | None = None
    low: str | None = None
    high: str | None = None
    logarithmic: bool = False
    per_run: bool = False


class ShapeKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.effects.NAME.shapes.VARIABLE]``: a variable that means nothing while the effect is absent."""

    tried: list[str]
    low: str | None = None
    high: str | None = None
    logarithmic: bool = False


class EffectKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.effects.NAME]``: a ``variable`` at whose value ``off`` something is absent, and how large it may be."""

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
    """``[[fmu.surfaces]]``: a term without a name in an input or an output, ``over`` two signals, each from … to."""

    signal: str
    over: dict[str, tuple[str, str]]
    typical: str
    knots: int = 5


class MeasuredKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu.measured.SIGNAL]``: ordinary errors of a measured signal, and which causes are looked for in it."""

    offset: str | None = None
    delay: str | None = None
    causes: list[Literal["gain", "offset", "drift", "lag", "latency", "held"]] | None = None


class FmuKeys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """``[fmu]`` as a whole."""

    parameters: str | None = (
        None  #: a parameter set (SSV) beside the map, in the place of the FMU's own values
    )
    base: dict[str, BaseKeys] = {}
    effects: dict[str, EffectKeys] = {}
    surfaces: list[SurfaceKeys] = []
    measured: dict[str, MeasuredKeys] = {}
    gauge: list[str] = []  #: pressures over that of the air around; else they are absolute
    step: str | None = None  #: of communication; else the step of the grid
    settle: str | None = None  #: inputs are held so long before a record begins
    hold: Literal["middle", "begin", "end"] = "middle"  #: which value of an input a communication step has
    patience: str = "60 s"
