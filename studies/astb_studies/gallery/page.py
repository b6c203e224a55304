"""docs/gallery.md, from the recipes: a sentence, a picture and the commands that make it, each."""

from collections.abc import Iterator
from typing import Final

from astb_studies.gallery.recipes import GALLERY, RECIPES

PAGE: Final = GALLERY.parent / "gallery.md"
HEAD: Final = """<!-- Written by `make gallery`; do not edit. -->

# Gallery

What this project does, in ten pictures, all made by the program. `make gallery` makes them anew,
`make gallery ARGS=rig` one of them.
"""
TAIL: Final = """## More

The [panel in a browser](how-to/watch-and-command-in-a-browser.md), as its tests saw it: [a run that is
held](gallery/panel-held-dark.png), [one that asks](gallery/panel-question.png), [after the
stop](gallery/panel-stopped.png), [without its server](gallery/panel-lost.png).

Other figures of the paper are made by the same [command](how-to/reproduce-the-paper.md) and explained [beside its
text](explanation/the-paper.md): [areas and volumes](gallery/figure-07.svg), [stiffness over the roll
angle](gallery/figure-10.svg), [comfort in the crosswind](gallery/comfort.svg). How the diagnosis comes to a
name is drawn on [its own page](explanation/how-the-diagnosis-works.md), which
`python -m astb_studies.benchmarks.diagnosis.explanation_drawings` illustrates anew, and how often it is right in [its
benchmark](../studies/docs/diagnosis-benchmark.md). Or see it happen: [a notebook](tutorials/bench.ipynb).
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
