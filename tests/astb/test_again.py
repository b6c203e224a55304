"""A stored run is simulated again, also from an instant: equal without a change, different with one."""

import pytest
from click.testing import CliRunner

from astb.cli import commands
from bench_records.record import read


def asked(*arguments):
    return CliRunner().invoke(commands, ["rehearse", *map(str, arguments)])


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    out = tmp_path_factory.mktemp("kept")
    CliRunner().invoke(commands, ["run", "leak_down", "--virtual", "--seed=5", f"--out={out}"])
    return out / "leak_down"


def test_without_a_change_it_goes_on_as_it_did_to_the_bit(kept, tmp_path):
    done = asked("--from", f"{kept}@40s", f"--out={tmp_path}")
    assert done.exit_code == 0, done.output
    assert "no deviation from the original run" in done.output
    before, now = read(kept), read(tmp_path / "leak_down-rehearsal")
    for name in ("left.bellows_pressure", "load_cell.3", "vertical_left.displacement"):
        assert [list(one) for one in before.series(name)] == [list(one) for one in now.series(name)]


def test_a_leak_changes_the_run_only_after_its_start(kept, tmp_path):
    done = asked("--from", f"{kept}@40s", "--fault", "leak side=left area=0.5mm2", f"--out={tmp_path}")
    text = " ".join(done.output.split())
    assert "up to 40 s the run is identical with" in text
    assert "air lost per minute, left spring" in text and "(before: air lost per minute, left spring" in text
    assert "right spring" not in text.split("; after that:")[1]
    before, now = (
        read(one).series("left.bellows_pressure") for one in (kept, tmp_path / "leak_down-rehearsal")
    )
    early = before[0] < 40.0
    assert list(before[1][early]) == list(now[1][now[0] < 40.0])
    assert now[1][now[0] < 60.0][-1] < before[1][before[0] < 60.0][-1] - 1000.0


@pytest.mark.slow
def test_an_effect_that_begins_there_is_the_fault_of_its_name_to_the_bit(kept, tmp_path):
    for name, change in (
        ("fault", ("--fault", "leak side=left area=0.5mm2")),
        ("effect", ("--effect", "leak.left=0.5mm2")),
    ):
        done = asked("--from", f"{kept}@40s", *change, f"--out={tmp_path / name}")
        assert done.exit_code == 0, done.output
        assert "continues from 40 s with leak" in " ".join(done.output.split())
    one, other = (read(tmp_path / name / "leak_down-rehearsal") for name in ("fault", "effect"))
    for name in ("left.bellows_pressure", "left.height", "load_cell.1", "supply.pressure"):
        assert [list(two) for two in one.series(name)] == [list(two) for two in other.series(name)]


def test_a_parameter_is_another_one_from_there_on_and_a_volume_keeps_its_gas(kept, tmp_path):
    done = asked(
        "--from", f"{kept}@40s", "--change", "auxiliary_volume=33 litre, 40 litre", f"--out={tmp_path}"
    )
    text = " ".join(done.output.split())
    assert done.exit_code == 0, text
    assert "auxiliary_volume = 33 litre, 40 litre; the mass and the energy of the gas remain" in text
    before, now = read(kept), read(tmp_path / "leak_down-rehearsal")
    assert "auxiliary_volume = 33 litre, 40 litre" in now.meta["otherwise"][0]
    for name in ("left.auxiliary_pressure", "right.auxiliary_pressure"):
        (times, was), (again, found) = before.series(name), now.series(name)
        assert list(was[times < 40.0]) == list(found[again < 40.0])
        assert abs(found[again > 40.1][0] - was[times > 40.1][0]) > 1000.0


@pytest.mark.slow
def test_options_of_the_original_run_are_read_from_its_record(tmp_path):
    run = ["run", "leak_down", "--virtual", "--seed=5", "--effect", "maxwell=0.31, time=0.7 s"]
    CliRunner().invoke(commands, [*run, f"--out={tmp_path}"])
    done = asked("--from", f"{tmp_path}/leak_down@40s", f"--out={tmp_path}")
    assert done.exit_code == 0, done.output
    assert "no deviation from the original run" in done.output


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--from", "{kept}"], "write RUN@TIME"),
        (["--from", "{kept}@900s"], "900 s is not within"),
        (["--from", "{kept}@40"], "40"),
        (["--from", "{kept}@40s", "aw0"], "name either"),
        (["--fault", "leak side=left"], "name either"),
        ([], "name either"),
        (["--from", "{kept}@40s", "--fault", "leek"], "leek is not a fault"),
        (["--from", "{kept}@40s", "--model", "{kept}/none.toml"], "none.toml"),
        (
            ["--from", "{kept}@40s", "--effect", "leek.left=1mm2"],
            "leek.left is not an effect; did you mean 'leak.left'",
        ),
        (["--from", "{kept}@40s", "--effect", "leak.left"], "NAME=VALUE, such as leak.left=0.2mm2"),
        (["--from", "{kept}@40s", "--effect", "leak.left=1m2"], "leak.left: area = 1e+06 mm2 is outside"),
        (["--from", "{kept}@40s", "--change", "bellows_volum=20l"], "did you mean 'bellows_volume'?"),
        (
            ["--from", "{kept}@40s", "--change", "bellows_volume=9m3"],
            "= 9000 litre is outside 5 to 200 litre",
        ),
        (
            ["--from", "{kept}@40s", "--change", "gas_constant=300J/(kg*K)"],
            "the gas in the springs keeps its mass",
        ),
        (["--from", "{kept}@40s", "--change", "gas_constant"], "NAME=VALUE, such as orifice_diameter=12mm"),
        (["aw0", "--change", "orifice_diameter=12mm"], "name either"),
    ],
)
def test_invalid_arguments_are_refused_with_a_reason(kept, tmp_path, arguments, why):
    done = asked(*(one.format(kept=kept) for one in arguments), f"--out={tmp_path}")
    assert done.exit_code == 2, done.output
    assert why in " ".join(done.output.split())


def test_a_record_of_a_real_rig_is_refused(kept, monkeypatch):
    from astb.rehearsal.again import plan_of
    from bench_records.layout import RecordError

    record = read(kept)
    for meta in ({"simulated": False}, {"time": "real"}, {"sealed_effects": True}, {"plan": "gone"}):
        monkeypatch.setattr(record, "meta", record.meta | meta)
        with pytest.raises(RecordError):
            plan_of(record)
        monkeypatch.undo()
