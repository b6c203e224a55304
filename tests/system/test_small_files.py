"""Small files that expand are refused, or read, without 1 GB of memory, whatever reads them."""

import importlib.util
import os
import subprocess
import sys

import pytest

from tests.own_process import ROOT
from tests.system.small_files import CASES

pytestmark = pytest.mark.slow

GIGABYTE = 10**9 >> 20  # MiB
#: Notes that cannot be read are shown as such.
READ = ("lists.json", "deep.json")
ERRORS = ("Unfit", "RecordError", "DbcError", "SpecimenError", "FmuError")


@pytest.fixture(scope="module")
def outputs(tmp_path_factory) -> dict[str, list[str]]:
    command = [sys.executable, "-m", "tests.system.small_files", str(tmp_path_factory.mktemp("small"))]
    run = subprocess.run(
        command, cwd=ROOT, env=os.environ, capture_output=True, text=True, timeout=600, check=True
    )
    rows = [line.split("\t") for line in run.stdout.splitlines()]
    return {row[0]: row[1:] for row in rows}


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", CASES)
def test_a_small_file_takes_less_than_a_gigabyte(outputs, name: str) -> None:
    if name.endswith(".mf4") and not importlib.util.find_spec("asammdf"):
        pytest.skip("MDF needs the extra mdf: `make test-mdf`")
    taken, error, text, *_ = outputs[name]
    assert int(taken) < GIGABYTE
    assert error == "read" if name in READ else error in ERRORS, text
