"""What is generated from the tables and checked in is what the tables say."""

import pytest

from tools.generate.files import ROOT, files


@pytest.mark.parametrize("path", files(), ids=lambda path: path.name)
def test_generated_files_are_up_to_date(path: object) -> None:
    assert path.read_text(encoding="utf-8") == files()[path], (
        f"run `make generate` ({path.relative_to(ROOT)})"
    )
