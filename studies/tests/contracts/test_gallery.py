"""The gallery has every picture, also as a thumbnail; pictures that need no run are reproduced exactly."""

import re
from pathlib import Path

from astb_studies.gallery.page import PAGE, page
from astb_studies.gallery.recipes import GALLERY, RECIPES
from astb_studies.places import DOCS, PAGES

SIZE = {".svg": 200_000, ".png": 150_000}


def test_the_page_is_written_from_the_recipes():
    assert PAGE.read_text() == page(), "`make gallery` writes it"


def test_every_picture_is_there_once_and_small():
    names = [one.file for one in RECIPES]
    assert re.findall(r"!\[[^\]]*\]\(gallery/(.*?)\)", PAGE.read_text()) == names
    for name in names:
        picture = GALLERY / name
        assert 0 < picture.stat().st_size <= SIZE[picture.suffix], name
    assert len(names) == len({one.title for one in RECIPES}) == 10


def test_a_picture_drawn_again_is_the_same(tmp_path):
    recipe = next(one for one in RECIPES if one.name == "rig")
    recipe.draw(tmp_path, tmp_path / recipe.file)
    assert (tmp_path / recipe.file).read_bytes() == (GALLERY / recipe.file).read_bytes()


def test_no_picture_lies_there_that_no_page_shows():
    shown_anywhere = {
        Path(name).name
        for folder in (DOCS, PAGES)
        for one in folder.rglob("*.md")
        for name in re.findall(r"\]\((\S*gallery/[^)#]+\.(?:svg|png))\)", one.read_text())
    }
    assert {one.name for one in GALLERY.iterdir()} <= shown_anywhere
