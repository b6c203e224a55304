"""The views of the page: each a module of ``page/``, and the routes that it needs of the server."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from astb.panel import bus, faults, kept, rehearsals, specimens, twin
from astb.panel.parts import Parts

if TYPE_CHECKING:
    from starlette.routing import BaseRoute


def _no_routes(parts: Parts) -> "Sequence[BaseRoute]":
    del parts
    return ()


@dataclass(frozen=True, slots=True)
class View:
    """A view: its name (that of its file in ``page/``), its title, and what makes its routes."""

    name: str
    title: str
    routes: "Callable[[Parts], Sequence[BaseRoute]]" = _no_routes


VIEWS: Final = (
    View("live", "Live", rehearsals.routes),
    View("twin", "Twin", twin.routes),
    View("runs", "Runs", kept.routes),
    View("diagnoses", "Diagnoses"),
    View("specimens", "Specimens", specimens.routes),
    View("faults", "Faults", faults.routes),
    View("bus", "Bus", bus.routes),
)
