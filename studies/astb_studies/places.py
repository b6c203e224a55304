"""Paths of the checkout and its documentation, where the studies write their results."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
DOCS: Final = ROOT / "docs"
#: Pages with counted and measured results.
PAGES: Final = ROOT / "studies" / "docs"
