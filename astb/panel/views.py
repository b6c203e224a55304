"""The views of the page: each a module of ``page/``, and the routes that it needs of the server."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

    from astb.panel.access import Access
    from astb.panel.runs import Runs
    from astb.panel.watch import Watch


@dataclass(frozen=True, slots=True)
class Parts:
    """What routes are made of: the rig as it is watched, its runs, who may do what, where records go."""

    watch: "Watch"
    runs: "Runs"
    access: "Access"
    out: Path


def _nothing(parts: Parts) -> "Sequence[BaseRoute]":
    del parts
    return ()


@dataclass(frozen=True, slots=True)
class View:
    """A view: its name (that of its file in ``page/``), its title, and what makes its routes."""

    name: str
    title: str
    routes: "Callable[[Parts], Sequence[BaseRoute]]" = _nothing


VIEWS: Final = (View("live", "Live"),)
