"""The templates of pages: values are inserted as escaped text, except those that a template marks as a drawing."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from jinja2 import Environment, Template

_HERE: Final = Path(__file__).parent


def environment(*folders: Path) -> Environment:
    """Return an environment of the templates in ``folders`` and then of this package, whose style all pages share.

    A missing value of a template is an error.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader([*folders, _HERE]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def template(name: str, folder: Path = _HERE) -> Template:
    """Return a template of this package, or of the ``folder`` of another one."""
    return environment(folder).get_template(name)
