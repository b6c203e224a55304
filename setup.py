"""What pyproject.toml cannot say: a wheel and an sdist write_commit which commit they were made of."""

import runpy
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

SOFTWARE = runpy.run_path("astb/software.py")


def write_commit(tree: str) -> None:
    """Write the commit, where anybody knows it, to where an installed package looks for it."""
    if commit := SOFTWARE["commit"]():
        (Path(tree) / "astb" / SOFTWARE["TOLD"]).write_text(f"{commit}\n", encoding="ascii")


class BuildWithCommit(build_py):
    """Builds the packages, and tells the commit among them."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            write_commit(self.build_lib)


class SourcesWithCommit(sdist):
    """Collects the sources, and tells the commit among them."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        super().make_release_tree(base_dir, files)
        write_commit(base_dir)


setup(cmdclass={"build_py": BuildWithCommit, "sdist": SourcesWithCommit})
