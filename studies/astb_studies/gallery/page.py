"""docs/gallery.md from the recipes: for each picture a sentence and its commands."""

from collections.abc import Iterator
from typing import Final

from astb_studies.gallery.recipes import GALLERY, RECIPES

PAGE: Final = GALLERY.parent / "gallery.md"
HEAD: Final = """<!-- Written by `make gallery`; do not edit. -->

# Gallery

Ten pictures of the main functions. `make gallery` draws all pictures, `make gallery ARGS=rig` only the first one.
"""
TAIL: Final = """## More

Screenshots of the [panel in a browser](how-to/watch-and-command-in-a-browser.md): [a held
run](gallery/panel-held-dark.png), [a question to the operator](gallery/panel-question.png), [after a
stop](gallery/panel-stopped.png), [without connection](gallery/panel-lost.png).

[The same command](how-to/reproduce-the-paper.md) makes other figures of the [paper](../studies/docs/the-paper.md):
[areas and volumes](gallery/figure-07.svg), [stiffness over the roll angle](gallery/figure-10.svg), [comfort in the
crosswind](gallery/comfort.svg). [How the diagnosis works](explanation/how-the-diagnosis-works.md) has more drawings
(`python -m astb_studies.benchmarks.diagnosis.explanation_drawings`). A
[notebook](tutorials/bench.ipynb) shows a whole diagnosis.
"""


def page() -> str:
    """Return the page."""
    return "\n".join(_lines())


def _lines() -> Iterator[str]:
    yield HEAD
    for one in RECIPES:
        yield f"## {one.title}\n"
        yield f"{one.sees}\n"
        yield f"![{one.title}](gallery/{one.file})\n"
        yield "```sh\n" + "\n".join(one.made_by) + "\n```\n"
    yield TAIL
