"""Questions to the operator: who answers, what is recorded, and the checks without an answer."""

import io
import os
import pty
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
from rich.console import Console

from astb.operators import AnswersFileError, SimulatedHand, Terminal, operator_for, read_answers, with_hand
from bench_protocol.clock import RealClock
from bench_records.record import read
from bench_records.result import CheckVerdict, Outcome
from drivers.errors import BenchTimeout, RigFault
from test_plans.asking import wait_for_somebody
from test_plans.execution import execute
from test_plans.operator import FirstOf, NoOperator, Question, QuestionBox, Script, Unanswered
from test_plans.plan import plan


def empty_plan(run):
    pass


def asking(within=600.0, then=None):
    @plan(setup=empty_plan, teardown=empty_plan)
    def asks(run):
        """Ask."""
        run.check("before", 1.0, "1", low=0.0)
        if run.confirm("fit the plate of 16 mm", "damping", within=within, deed="plate 16"):
            run.check("damping", 5.0, "1", low=0.0)

    return asks


@pytest.fixture
def asked(bench_composed, tmp_path):
    """Run a plan that asks on a virtual rig; return its result and the record's events."""

    def run(operator, **rest):
        with bench_composed() as made:
            result = execute(asking(**rest), made.bench, tmp_path / "out", operator=operator)
        events = [
            (e.kind, e.text, e.data) for e in read(tmp_path / "out").events if e.kind in {"prompt", "answer"}
        ]
        return result, events

    return run


def test_a_script_answers_and_the_record_says_what_was_asked_and_who_answered(asked):
    result, (prompt, answer) = asked(Script({"Fit the plate of *": "done"}, by="night shift"))
    assert result.verdict is Outcome.PASS
    assert prompt[:2] == ("prompt", "fit the plate of 16 mm")
    assert prompt[2]["answers"] == ["done", "not possible"]
    assert answer[:2] == ("answer", "done")
    assert answer[2]["by"] == "night shift"


@pytest.mark.parametrize(
    ("operator", "why"),
    [
        (NoOperator(), "fit the plate of 16 mm: there is no operator to ask"),
        (
            Script({"something else": "done"}, by="answers.toml"),
            "answers.toml has no answer to this question",
        ),
        (Script({"plate 16": "not possible"}), "the operator answered 'not possible'"),
    ],
)
def test_signals_without_a_source_are_not_available_with_a_reason(asked, operator, why):
    result, _ = asked(operator, within=0.1)
    assert result.verdict is Outcome.INCOMPLETE
    assert [one.verdict for one in result.checks] == [CheckVerdict.PASS, CheckVerdict.NOT_AVAILABLE]
    assert why in result.checks[1].note


def test_an_unanswered_request_for_handwork_ends_the_run(asked):
    result, _ = asked(QuestionBox(), within=0.1)
    assert result.verdict is Outcome.BLOCKED
    assert "fit the plate of 16 mm: no answer within 0.1 s; " in result.reason
    assert "; a person may be at the rig" in result.reason


def test_whoever_answers_abort_ends_the_run(asked):
    result, _ = asked(Script({"*": "abort"}, by="the panel"))
    assert result.verdict is Outcome.BLOCKED
    assert "the panel ended the run when asked: fit the plate" in result.reason


def test_a_question_that_is_answered_wrongly_by_a_script_is_the_plans_trouble_and_never_a_pass(asked):
    result, _ = asked(Script({"*": "yes"}))
    assert result.verdict is Outcome.BLOCKED
    assert (
        "'yes' is not an answer to 'fit the plate of 16 mm'; use one of done, not possible, abort"
        in result.reason
    )


def test_a_box_is_answered_from_another_thread_while_virtual_time_stands(bench_composed, tmp_path):
    box, clock, seen = QuestionBox(), RealClock(), []

    def somebody():
        while box.question is None:
            clock.sleep_until(clock.now() + 1_000_000)
        seen.append(box.question.text)
        box.reply("done", by="the panel")

    with bench_composed() as made:
        thread = threading.Thread(target=somebody)
        thread.start()
        before = made.clock.now()
        result = execute(asking(within=10.0), made.bench, tmp_path / "out", operator=box)
        thread.join(10)
        assert made.clock.now() == before  # the rig's time stopped during the question
    assert seen == ["fit the plate of 16 mm"]
    assert result.verdict is Outcome.PASS
    assert box.question is None
    with pytest.raises(ValueError, match="no question is open"):
        box.reply("done", by="the panel")


def test_a_box_takes_allowed_answers_once():
    box = QuestionBox()
    box.ask(Question("ready?", ("yes", "no")))
    with pytest.raises(
        ValueError, match="'perhaps' is not an answer to 'ready\\?'; use one of yes, no, abort"
    ):
        box.reply("perhaps", by="a")
    box.reply("yes", by="a")
    with pytest.raises(ValueError, match="no question is open"):
        box.reply("no", by="b")
    assert (box.answer().text, box.answer().by) == ("yes", "a")


@pytest.mark.parametrize(("typed", "answer"), [("done\n", "done"), ("what\n\nN\n", "not possible")])
def test_at_a_terminal_the_beginning_of_an_answer_is_enough(asked, typed, answer):
    shown = io.StringIO()
    _, events = asked(Terminal(Console(file=shown), io.StringIO(typed)), within=10.0)
    assert events[1][1] == answer
    assert "? fit the plate of 16 mm  [done / not possible / abort], within 10 s" in shown.getvalue()
    assert ("'what' is not an answer" in shown.getvalue()) == typed.startswith("what")


def answered(terminal, text):
    """Ask, and return the answer, or why there is none."""
    clock = RealClock()
    terminal.ask(Question(text))
    for _ in range(2000):
        try:
            if found := terminal.answer():
                terminal.withdraw()
                return found.text
        except Unanswered as reason:
            return str(reason)
        clock.sleep_until(clock.now() + 1_000_000)
    return "nothing came"


CLOSED = "the terminal is closed; answer in the panel or by --answers FILE"


def test_lines_of_a_pipe_answer_one_question_each():
    terminal = Terminal(Console(file=io.StringIO()), io.StringIO("done\nnot\nwhat\ndone\n"))
    assert [answered(terminal, f"{n}") for n in range(4)] == [
        "done",
        "not possible",
        "done",
        CLOSED,
    ]


def test_what_is_no_text_closes_a_terminal_and_leaves_no_question_waiting():
    lines = io.TextIOWrapper(io.BytesIO(b"\xff\n"), encoding="utf-8")
    assert answered(Terminal(Console(file=io.StringIO()), lines), "ready?") == CLOSED


def test_earlier_keyboard_input_does_not_answer_a_question():
    here, there = pty.openpty()
    with os.fdopen(there, encoding="utf-8") as lines:
        os.write(here, b"done\n")
        terminal, clock = Terminal(Console(file=io.StringIO()), lines), RealClock()
        clock.sleep_until(clock.now() + 20_000_000)
        threading.Timer(0.2, os.write, (here, b"not\n")).start()
        assert answered(terminal, "press the emergency stop") == "not possible"
    os.close(here)


BACKGROUND = """
import io, os, sys
from rich.console import Console
from astb.operators import Terminal
from test_plans.operator import Question, Unanswered

def ask():
    try:
        Terminal(Console(file=io.StringIO()), lines).ask(Question("ready?"))
        print("asked", flush=True)
    except Unanswered as reason:
        print(reason, flush=True)

lines = open(sys.argv[1])  # a session without a terminal makes the first that it opens its own
if os.fork():
    os.wait()
    ask()
else:
    os.setpgrp()
    ask()
"""


def test_a_background_job_asks_no_question():
    here, there = pty.openpty()
    done = subprocess.run(
        [sys.executable, "-c", BACKGROUND, os.ttyname(there)],
        start_new_session=True,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    os.close(here)
    os.close(there)
    refused, asked = done.stdout.splitlines()
    assert refused.startswith("the process runs in the background of its terminal")
    assert asked == "asked"


def test_a_simulated_rig_on_another_machine_leaves_the_question_to_others():
    def order(told):
        raise ConnectionRefusedError(111, "Connection refused")

    operator = with_hand(QuestionBox(), SimulatedHand(order))
    operator.ask(Question("press the emergency stop", deed="estop on"))
    assert operator.answer() is None, "it is asked, and somebody may answer"
    with pytest.raises(Unanswered, match="does not receive the command: Connection refused"):
        SimulatedHand(order).ask(Question("press the emergency stop", deed="estop on"))


def test_a_closed_terminal_gives_no_answer(asked):
    result, _ = asked(Terminal(Console(file=io.StringIO()), io.StringIO("")), within=10.0)
    assert result.verdict is Outcome.INCOMPLETE
    assert "the terminal is closed" in result.checks[1].note


def test_a_simulated_rig_does_by_itself_what_its_faults_can_and_says_what_it_cannot():
    orders = []

    def order(told):
        orders.append(told)
        if told["do"] == "list":
            return {"faults": [{"name": "estop"}]}
        if told["do"] == "off":
            return {"error": f"{told['name']} is not on"}
        return {} if told["name"] == "estop" else {"error": f"there is no fault {told['name']!r}"}

    hand = SimulatedHand(order)
    hand.ask(Question("press the emergency stop", deed="estop on"))
    assert hand.answer().text == "done"
    assert orders == [{"do": "on", "name": "estop", "values": {}}]
    hand.ask(Question("see to it that the emergency stop is released", deed="estop off"))
    assert hand.answer().text == "done", "it was not pressed"
    for question in (
        Question("look", deed=""),
        Question("turn it", deed="crank on"),
        Question("turn it", deed="crank off"),
    ):
        with pytest.raises(Unanswered, match="cannot do this by itself"):
            hand.ask(question)


def test_a_script_goes_before_the_simulated_hand_and_a_terminal_behind_it():
    question = Question("press", deed="estop on")
    for operator, by in (
        (Script({"estop on": "not possible"}, by="me"), "me"),
        (QuestionBox(), "the simulated rig"),
    ):
        both = with_hand(operator, SimulatedHand(lambda order: {}))
        both.ask(question)
        assert both.answer().by == by
    nobody = FirstOf(NoOperator(), Script({}))
    with pytest.raises(
        Unanswered, match=r"there is no operator to ask.*; a script has no answer to this question"
    ):
        nobody.ask(question)


def test_answers_come_from_a_toml_file(tmp_path):
    path = tmp_path / "answers.toml"
    path.write_text('"fit the plate of *" = "done"\n')
    script = operator_for(str(path), Console())
    script.ask(Question("fit the plate of 10 mm"))
    assert (script.answer().text, script.answer().by) == ("done", "answers.toml")
    for text, why in (("a = 1", "an answer must be a text"), ("a =", "is not TOML")):
        path.write_text(text)
        with pytest.raises(AnswersFileError, match=why):
            read_answers(path)
    with pytest.raises(AnswersFileError, match="cannot be read"):
        read_answers(tmp_path / "none.toml")


def test_in_real_time_the_bench_is_commanded_and_watched_while_somebody_thinks():
    waited = []

    def wait_for(condition, within, what):
        waited.append((within, what))
        if len(waited) == 2:
            raise BenchTimeout("nobody answered")
        if len(waited) == 3:
            raise RigFault("the emergency stop was pressed")

    run = SimpleNamespace(bench=SimpleNamespace(clock=RealClock(), wait_for=wait_for))
    assert wait_for_somebody(run, lambda: False, 60.0, "an answer") is True
    assert wait_for_somebody(run, lambda: False, 60.0, "an answer") is False
    with pytest.raises(RigFault):  # what happens to the rig is not the operator's to answer
        wait_for_somebody(run, lambda: False, 60.0, "an answer")
    assert waited == [(60.0, "an answer")] * 3
