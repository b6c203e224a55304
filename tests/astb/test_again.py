"""A kept run is gone through again, and on from an instant: without a change as before, with one otherwise."""

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
    assert "it goes on as it did" in done.output
    before, now = read(kept), read(tmp_path / "leak_down-rehearsal")
    for name in ("left.bellows_pressure", "load_cell.3", "vertical_left.displacement"):
        assert [list(one) for one in before.series(name)] == [list(one) for one in now.series(name)]


def test_with_a_leak_it_is_the_same_before_and_another_afterwards(kept, tmp_path):
    done = asked("--from", f"{kept}@40s", "--fault", "leak side=left area=0.5mm2", f"--out={tmp_path}")
    told = " ".join(done.output.split())
    assert "up to 40 s it is" in told
    assert "air lost per minute, left spring" in told and "(it was: air lost per minute, left spring" in told
    assert "right spring" not in told.split("to the bit")[1]
    before, now = (
        read(one).series("left.bellows_pressure") for one in (kept, tmp_path / "leak_down-rehearsal")
    )
    early = before[0] < 40.0
    assert list(before[1][early]) == list(now[1][now[0] < 40.0])
    assert now[1][now[0] < 60.0][-1] < before[1][before[0] < 60.0][-1] - 1000.0


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--from", "{kept}"], "RUN@TIME would be right"),
        (["--from", "{kept}@900s"], "is not within it"),
        (["--from", "{kept}@40"], "40"),
        (["--from", "{kept}@40s", "aw0"], "one of the two"),
        (["--fault", "leak side=left"], "one of the two"),
        ([], "one of the two"),
        (["--from", "{kept}@40s", "--fault", "leek"], "leek is no fault"),
        (["--from", "{kept}@40s", "--effect", "leak.left=1mm2"], "was not made by this rig"),
    ],
)
def test_what_cannot_be_is_refused_in_words(kept, tmp_path, arguments, why):
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
