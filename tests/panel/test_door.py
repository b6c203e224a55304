"""The control socket of a run: requests arrive, and impossible ones are reported."""

from types import SimpleNamespace

import pytest

from astb.live.door import Door, NoRun, door_path, knock, opened_door
from bench_sim.rig.control_socket import ask
from test_plans.operator import Answer, Question, QuestionBox
from test_plans.suspension import Suspension


@pytest.fixture
def rig_file(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "rig.toml"


@pytest.fixture
def run(rig_file):
    """A run's side of the door: what holds it, and where its questions wait."""
    suspension, box = Suspension(), QuestionBox()
    with opened_door(rig_file, Door(lambda: None, suspension, box)):
        yield suspension, box


def test_a_run_is_held_and_goes_on(run, rig_file):
    suspension, _ = run
    knock(rig_file, {"do": "hold", "by": "A. Miller"})
    assert suspension.wanted_by == "A. Miller"
    knock(rig_file, {"do": "resume"})
    assert suspension.wanted_by == ""


def test_a_plan_that_can_be_held_nowhere_is_not_asked_to(rig_file):
    suspension = Suspension()
    live = SimpleNamespace(cannot_hold="this plan cannot be held")
    with opened_door(rig_file, Door(lambda: live, suspension, None)):
        assert "this plan cannot be held" in knock(rig_file, {"do": "hold"})["error"]
    assert suspension.wanted_by == ""


def test_a_question_is_answered_and_a_wrong_answer_is_reported(run, rig_file):
    _, box = run
    assert "no question is open" in knock(rig_file, {"do": "answer", "text": "yes"})["error"]
    box.ask(Question("well?", ("yes", "no")))
    assert "yes, no, abort" in knock(rig_file, {"do": "answer", "text": "perhaps"})["error"]
    late = knock(rig_file, {"do": "answer", "text": "yes", "to": "the one before?"})
    assert "the present question is 'well?'" in late["error"], (
        "a second tap does not answer the next question"
    )
    assert box.answer() is None
    knock(rig_file, {"do": "answer", "text": "yes", "by": "A. Miller", "to": "well?"})
    assert box.answer() == Answer("yes", "A. Miller")


@pytest.mark.parametrize("line", [b"{}", b"[]", b"nonsense", b'{"do":"explode"}', b'{"do":3}', b"\xff", b""])
def test_an_unknown_message_is_reported_and_the_socket_stays_open(run, rig_file, line):
    assert b"error" in ask(door_path(rig_file), line)
    assert knock(rig_file, {"do": "look"})["snapshot"] is None


def test_a_control_socket_is_private_and_removed_with_its_run(rig_file):
    door = Door(lambda: None, Suspension(), None)
    with opened_door(rig_file, door):
        assert door_path(rig_file).stat().st_mode & 0o077 == 0
        with opened_door(rig_file, Door(lambda: None, Suspension(), None)):
            pass  # another run on the same rig has no door, and does not take this one away
        assert "takes no answers" in knock(rig_file, {"do": "answer", "text": "yes"})["error"]
    with pytest.raises(NoRun):
        knock(rig_file, {"do": "look"})
    assert not door_path(rig_file).exists()


def test_a_door_that_a_killed_run_left_is_taken_over(rig_file):
    path = door_path(rig_file)
    path.parent.mkdir(mode=0o700)
    path.touch()
    with opened_door(rig_file, Door(lambda: None, Suspension(), None)):
        assert "pid" in knock(rig_file, {"do": "look"})
