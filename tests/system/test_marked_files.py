"""All TOML files may begin with a byte order mark; one in another encoding is refused in words."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

from astb.campaigns.campaign_file import CampaignError, read_campaign
from astb.commands.plan_values import _read as read_values
from astb.operators import AnswersFileError, read_answers
from astb.rig_file import RigFileError
from astb.rig_file import read as read_rig
from bench_protocol.table import TABLE
from bench_sim.parameters import ParameterError, load
from diagnosis.contracts import DiagnosisError
from diagnosis.systems.map_file import read_map
from drivers.errors import WiringError
from drivers.wiring.description import read_description
from test_plans.instruments import InstrumentsError, read_instruments
from test_plans.specimen import SpecimenError, read_specimen

ROOT = Path(__file__).parents[2]


def wiring(path: Path) -> Any:
    return read_description(path, TABLE)


def campaign(path: Path) -> Any:
    with pytest.raises(CampaignError) as refused:  # a good one would begin to prepare its runs
        read_campaign(path)
    if "none.toml" not in str(refused.value):
        raise refused.value
    return str(refused.value)


def map_of(path: Path) -> Any:
    return read_map(path)[0]


@pytest.mark.parametrize(
    ("reader", "like", "error"),
    [
        (read_rig, "astb/data/rigs/virtual/rig.toml", RigFileError),
        (read_specimen, "astb/data/specimens/astb.toml", SpecimenError),
        (read_instruments, "astb/data/rigs/local/instruments.toml", InstrumentsError),
        (wiring, "astb/data/rigs/plant_a/wiring.toml", WiringError),
        (map_of, "astb/data/demos/piston/piston.toml", DiagnosisError),
        (load, "bench_sim/parameters/astb.toml", ParameterError),
        (campaign, 'plans = ["leak_down"]\nrig = "none.toml"\n', CampaignError),
        (read_answers, '"*" = "done"\n', AnswersFileError),
        (read_values, "duration = 3\n", click.exceptions.Exit),
    ],
)
def test_a_byte_order_mark_is_ignored_and_another_encoding_is_reported(
    reader: Callable[[Path], Any], like: str, error: type[Exception], tmp_path, capsys
) -> None:
    text = (ROOT / like).read_text(encoding="utf-8") if like.endswith(".toml") else like
    path = tmp_path / "file.toml"
    path.write_text(text, encoding="utf-8")
    for beside in ((ROOT / like).parent).glob("*") if like.endswith(".toml") else ():
        if beside.is_file() and beside.name != Path(like).name:
            (tmp_path / beside.name).write_bytes(beside.read_bytes())
    plain = reader(path)
    path.write_text(text, encoding="utf-8-sig")
    marked = reader(path)
    assert type(marked) is type(plain)
    path.write_bytes((text + "\n# Größe\n").encode("cp1252", "replace"))
    with pytest.raises(error) as refused:
        reader(path)
    said = str(refused.value) + capsys.readouterr().err
    assert "file.toml is not in UTF-8: line" in said
    assert "in cp1252; save it as UTF-8" in said
