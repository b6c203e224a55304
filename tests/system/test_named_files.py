"""Files that come with the bench have names, wherever one stands, and can be copied to begin one's own with."""

import json
from pathlib import Path

import pytest

from astb.exit_codes import MISUSE, PASS
from astb.rig_file import RigFileError, find_rig, read
from bench_protocol.dimensions import read_dimensions
from bench_protocol.named_files import named_files
from bench_protocol.table import TABLE
from bench_sim.parameters import load
from drivers.wiring.description import read_description
from test_plans.instruments import read_instruments
from test_plans.specimen import read_specimen

#: How each kind of file is read, of one's own as well as of ours.
KINDS = {
    "rigs": read,
    "specimens": read_specimen,
    "instruments": read_instruments,
    "dimensions": read_dimensions,
    "wirings": lambda path: read_description(path, TABLE),
    "parameters": load,
}


@pytest.fixture
def cli(astb_here, tmp_path):
    """Run ``astb`` with arguments in an empty directory: exit code, stdout, stderr."""
    return lambda *arguments: astb_here(tmp_path, *arguments)


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_list_names_can_be_asked_for_copied_and_read_as_ones_own(kind, cli, tmp_path):
    status, said, _ = cli("list", kind, "--json")
    assert status == PASS
    names = [one["name"] for one in json.loads(said)]
    assert names == [line.split()[0] for line in cli("list", kind)[1].splitlines()]
    assert names
    for name in names:
        assert len(json.loads(cli("list", kind, name, "--json")[1])) == 1
        copy = tmp_path / f"my_{name}.toml"
        assert cli("copy", kind, name, copy)[0] == PASS
        KINDS[kind](copy)
        status, _, err = cli("copy", kind, name, copy)
        assert (status, "exists already" in err) == (MISUSE, True)
    assert cli("copy", kind, "nobody", "new.toml")[0] == MISUSE
    assert cli("copy", kind, names[0], "new")[0] == MISUSE, "without an ending it would be a name"
    assert not list(tmp_path.glob("new*"))


def test_all_files_of_rigs_specimens_instruments_and_wirings_have_names():
    root = Path(__file__).parents[2]
    for package in ("rigs", "specimens", "instruments", "dimensions", "wirings"):
        assert named_files(package) == {path.stem: path for path in (root / package).glob("*.toml")}
        assert named_files(package)


def test_a_name_is_that_of_a_file_here_before_that_of_one_of_ours_and_a_path_is_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_rig()[0] == find_rig("local")[0] == read(named_files("rigs")["local"])
    assert find_rig("virtual")[0].time == "virtual"
    (tmp_path / "rigs").mkdir()
    for path in ("rigs/local.toml", "rigs/mine.toml", "local.toml", "plain"):
        (tmp_path / path).write_text(f'name = "{path}"')
        assert find_rig(path)[0].name == path
    assert find_rig()[0].name == "rigs/local.toml"
    assert find_rig("mine")[0].name == "rigs/mine.toml"
    with pytest.raises(
        RigFileError, match="no rig 'mien': the path of a rig file, or hall or local or mine or"
    ):
        find_rig("mien")
    with pytest.raises(RigFileError, match=r"rig file mien\.toml cannot be read"):
        find_rig("mien.toml")


def test_the_command_line_takes_every_rig_by_its_name(cli):
    for arguments in ((), ("--rig", "local"), ("--rig", "virtual")):
        status, said, _ = cli("rig", "limits", *arguments)
        assert (status, said.startswith("left.height")) == (PASS, True)


def test_a_rig_file_names_instruments_and_a_wiring_that_come_with_the_bench(tmp_path):
    from astb.session import instruments_of, wiring_of

    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\nwiring = "plant_a"\ninstruments = "astb"')
    assert wiring_of(read(path), path).text == "A PLC on Modbus/TCP, process image every 50 ms"
    assert instruments_of(read(path), path).file == "astb.toml"


def test_measured_data_are_copied_with_their_map_and_read_as_ones_own(cli, tmp_path):
    from diagnosis.systems.mapping import read_mapped

    told = json.loads(cli("list", "demos", "--json")[1])
    assert [one["name"] for one in told] == ["chamber", "piston"]
    assert cli("copy", "demo", "chamber", tmp_path / "mine")[0] == PASS
    files = sorted((tmp_path / "mine").glob("*.csv"))
    assert [path.name for path in files] == told[0]["files"]
    _, dataset = read_mapped(files[:1], tmp_path / "mine" / told[0]["map"])
    assert len(dataset.runs) > 5
    for arguments, reason in (
        (("copy", "demo", "chamber", "mine"), "exists already"),
        (("list", "demos", "nobody"), "there is no demo"),
    ):
        status, _, err = cli(*arguments)
        assert (status, reason in err) == (MISUSE, True)
