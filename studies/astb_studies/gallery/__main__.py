"""Make the gallery again: python -m astb_studies.gallery [NAME…], all pictures unless some are named, and the page."""

import argparse
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from astb_studies.gallery.page import PAGE, page
from astb_studies.gallery.recipes import GALLERY, RECIPES, RUNS, Recipe
from astb_studies.places import ROOT

#: Where the commands find the files of rigs.


def make(recipes: Sequence[Recipe], into: Path) -> None:
    """Call each command of the recipes once, with a new folder for its runs, and write the pictures to ``into``."""
    with tempfile.TemporaryDirectory() as folder:
        for command in dict.fromkeys(command for one in recipes for command in one.commands):
            print(command, file=sys.stderr)
            subprocess.run(
                [sys.executable, "-m", *shlex.split(command.replace(RUNS, folder))],
                cwd=ROOT,
                check=True,
                stdout=subprocess.DEVNULL,
            )
        for one in recipes:
            print(one.file, file=sys.stderr)
            one.draw(Path(folder), into / one.file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = [one.name for one in RECIPES]
    parser.add_argument("name", nargs="*", choices=[*names, []], metavar="NAME", help=", ".join(names))
    chosen = parser.parse_args().name or names
    make([one for one in RECIPES if one.name in chosen], GALLERY)
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
