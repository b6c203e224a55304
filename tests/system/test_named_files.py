"""Files that come with the bench have names, wherever one stands, and can be copied to begin one's own with."""

import json
from pathlib import Path

import pytest

from astb.exit_codes import MISUSE, PASS
from astb.rig_file import RigFileError, find_rig, read
from astb.session import dimensions_of, instruments_of, wiring_of
from bench_protocol.dimensions import UNKNOWN, read_dimensions
from bench_protocol.named_files import OF_A_RIG, named_files
from bench_protocol.table import TABLE
from bench_sim.parameters import load
from drivers.wiring.description import read_description
from test_plans.instruments import ordinary as ordinary_instruments
from test_plans.instruments import read_instruments
from test_plans.specimen import read_specimen
from tests.refusals import refuses

#: How each kind of file is read, for users' files as well as ours.
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
        copy = tmp_path / (f"my_{name}" if kind == "rigs" else f"my_{name}.toml")
        assert cli("copy", kind, name, copy)[0] == PASS
        KINDS[kind](copy / "rig.toml" if kind == "rigs" else copy)
        status, _, err = cli("copy", kind, name, copy)
        assert (status, "exists already" in err) == (MISUSE, True)
    right, wrong = ("new", "new.toml") if kind == "rigs" else ("new.toml", "new")
    assert cli("copy", kind, "nobody", right)[0] == MISUSE
    assert cli("copy", kind, names[0], wrong)[0] == MISUSE
    assert not list(tmp_path.glob("new*"))


def test_all_files_of_rigs_specimens_instruments_and_wirings_have_names():
    data = Path(__file__).parents[2] / "astb" / "data"
    assert named_files("specimens") == {path.stem: path for path in (data / "specimens").glob("*.toml")}
    for kind, file in OF_A_RIG.items():
        assert named_files(kind) == {path.parent.name: path for path in (data / "rigs").glob(f"*/{file}")}
        assert named_files(kind)


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
    with refuses(RigFileError, "'mien' 'mine'"):
        find_rig("mien")
    with refuses(RigFileError, "mien.toml"):
        find_rig("mien.toml")


def test_the_command_line_takes_every_rig_by_its_name(cli):
    for arguments in ((), ("--rig", "local"), ("--rig", "virtual")):
        status, said, _ = cli("rig", "limits", *arguments)
        assert (status, said.startswith("left.height")) == (PASS, True)


def a_rig(folder: Path, text: str, *files: Path) -> Path:
    """Write the folder of a rig, with copies of some files; return the path of its rig file."""
    folder.mkdir(parents=True)
    for file in files:
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / "rig.toml").write_text(text)
    return folder / "rig.toml"


def test_a_rig_is_a_folder_and_inherits_the_files_that_it_lacks(tmp_path):
    path = a_rig(tmp_path / "mine", 'name = "mine"\nlike = "plant_a"\n', named_files("instruments")["local"])
    rig, found = find_rig(tmp_path / "mine")
    assert found == path
    assert wiring_of(rig, path).where == named_files("wirings")["plant_a"]
    assert instruments_of(rig, path).file == "mine/instruments.toml"
    assert instruments_of(rig, path).pieces == ordinary_instruments().pieces
    assert dimensions_of(rig, path) == UNKNOWN
    path = a_rig(tmp_path / "deep" / "yours", 'name = "yours"\nlike = "../../mine"\n')
    rig = read(path)
    assert wiring_of(rig, path).where == named_files("wirings")["plant_a"]
    assert instruments_of(rig, path).file == "mine/instruments.toml"


def test_a_rig_with_addresses_or_a_simulation_does_not_inherit_a_wiring(tmp_path):
    for table in ("[can]", "[modbus]", "[simulation]"):
        path = a_rig(tmp_path / table, f'name = "mine"\nlike = "plant_a"\n{table}\n')
        assert read(path).wiring == ""
        (path.parent / "wiring.toml").write_bytes(named_files("wirings")["local"].read_bytes())
        assert read(path).wiring == "", "it is that of the virtual bench"
        (path.parent / "wiring.toml").write_bytes(named_files("wirings")["plant_a"].read_bytes())
        with refuses(RigFileError):
            read(path)


def test_a_copy_of_each_rig_is_read_as_the_rig_itself(cli, tmp_path):
    for name in named_files("rigs"):
        assert cli("copy", "rig", name, tmp_path / name)[0] == PASS
        (ours, there), (theirs, here) = find_rig(name), find_rig(tmp_path / name)
        assert here == tmp_path / name / "rig.toml"
        assert ours.simulation == theirs.simulation
        assert instruments_of(ours, there).pieces == instruments_of(theirs, here).pieces
        assert dimensions_of(ours, there).known == dimensions_of(theirs, here).known
        assert wiring_of(ours, there).digest == wiring_of(theirs, here).digest


def test_dimensions_in_the_folder_of_a_simulated_rig_are_those_of_the_file(tmp_path):
    text = named_files("dimensions")["local"].read_text().replace("value = 1200.0", "value = 1300.0")
    path = a_rig(tmp_path / "mine", 'name = "mine"\n[simulation]\nchange = { bolster_mass = "1400 kg" }\n')
    assert dimensions_of(read(path), path).known["bolster_mass"].value == 1400.0
    (path.parent / "dimensions.toml").write_bytes(named_files("dimensions")["local"].read_bytes())
    assert dimensions_of(read(path), path).known["bolster_mass"].value == 1400.0
    (path.parent / "dimensions.toml").write_text(text)
    assert dimensions_of(read(path), path).known["bolster_mass"].value == 1300.0


def test_a_rig_cannot_be_like_itself_or_like_one_that_there_is_not(tmp_path):
    first = a_rig(tmp_path / "first", 'name = "first"\nlike = "../second"\n')
    a_rig(tmp_path / "second", 'name = "second"\nlike = "../first"\n')
    with refuses(RigFileError):
        read(first)
    first.write_text('name = "first"\nlike = "loca"\n')
    with refuses(RigFileError, "rig.toml 'loca' 'local'"):
        read(first)


def test_keys_names_and_paths_of_version_0_1_are_read_with_a_warning(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\nwiring = "plant_a"\ninstruments = "astb"')
    with pytest.warns(FutureWarning) as warned:
        rig = read(path)
        assert wiring_of(rig, path).text == "A PLC on Modbus/TCP, process image every 50 ms"
        assert instruments_of(rig, path) == ordinary_instruments()
    assert len(warned) == 3
    for reader, earlier, now in (
        (find_rig, "rigs/local.toml", "local"),
        (read_specimen, "specimens/astb.toml", "astb"),
        (read_instruments, "instruments/astb.toml", "local"),
        (read_dimensions, "dimensions/astb.toml", "local"),
    ):
        with pytest.warns(FutureWarning, match=f'use the name "{now}"'):
            assert reader(earlier) == reader(now)


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
