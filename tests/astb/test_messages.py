"""Messages of a run: a command and a web server of this machine hear of a question and of the end, others do not."""

import json
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from click.testing import CliRunner

from astb.commands.run import run_command
from astb.exit_codes import MISUSE
from astb.messages import WITHIN, MessageError, Messages, receiver
from astb.operators import Terminal
from astb.rig_file import RigFile, Simulation
from astb.run import Keeping, run_plans
from bench_records.result import check, conclude
from test_plans.analysis.uncertainty import yes_or_no
from test_plans.operator import Question, QuestionBox, Script
from test_plans.plan import plan

RESULT = conclude("aw0", "Title.", "Title.", [check("height", 2.0, "m", low=0.0, high=1.0)], rig="hall")


@pytest.fixture
def server():
    """A web server that stores requests in ``server.heard`` and answers with ``server.answer``."""

    class Keeps(BaseHTTPRequestHandler):
        def do_POST(self):
            received = self.rfile.read(int(self.headers["Content-Length"]))
            self.server.heard.append((self.path, self.headers, json.loads(received)))
            self.send_response(self.server.answer)
            self.send_header("Location", f"http://127.0.0.1:{self.server.server_port}/moved")
            self.end_headers()

        def log_message(self, *_):
            pass

    one = HTTPServer(("127.0.0.1", 0), Keeps)
    one.heard, one.answer = [], 204
    thread = threading.Thread(target=one.serve_forever, args=(0.01,))
    thread.start()
    yield one
    one.shutdown()
    thread.join()
    one.server_close()


@pytest.fixture
def sent():
    """Send messages and return what went wrong, when all are through."""

    def made(to, tell) -> list[str]:
        messages, wrong = Messages(receiver(to)), []
        messages.warn = wrong.append
        tell(messages)
        for thread in threading.enumerate():
            if thread.name == "message":
                thread.join(WITHIN + 1.0)
        return wrong

    return made


def test_a_webhook_hears_of_the_end_and_of_a_question(server, sent, tmp_path):
    to = f"http://127.0.0.1:{server.server_port}/hook?room=2"
    assert sent(to, lambda messages: messages.ended(RESULT, tmp_path)) == []
    path, heads, told = server.heard.pop()
    assert (path, heads["Content-Type"]) == ("/hook?room=2", "application/json")
    assert (told["event"], told["plan"], told["rig"], told["verdict"]) == ("end", "aw0", "hall", "fail")
    assert told["failed"] == ["height"] and told["record"] == str(tmp_path)
    assert told["text"] == "aw0: fail: 1 of 1 check outside the limits"

    box = QuestionBox()
    asked = Question("Fit the plate", within=60.0)
    assert sent(to, lambda messages: messages.operator(box, "aw0").ask(asked)) == []
    told = server.heard.pop()[2]
    assert (told["event"], told["question"], told["answers"][0]) == ("question", "Fit the plate", "done")
    assert box.question is asked
    script = Script({"*": "done"})
    assert Messages(receiver(to)).operator(script, "aw0") is script, "who knows the answer is not called"
    assert issubclass(Terminal, QuestionBox)


def test_unreached_set_points_are_reported_and_not_followed(server, sent, tmp_path):
    server.answer = 302
    to = f"http://localhost:{server.server_port}/hook"
    (wrong,) = sent(to, lambda messages: messages.ended(RESULT, tmp_path))
    assert "the server answered with status 302" in wrong and [path for path, *_ in server.heard] == ["/hook"]
    (wrong,) = sent("http://127.0.0.1:1/", lambda messages: messages.ended(RESULT, tmp_path))
    assert "Connection refused" in wrong
    (wrong,) = sent("false", lambda messages: messages.ended(RESULT, tmp_path))
    assert "the command ended with exit code 1" in wrong


def test_a_command_hears_the_words_as_its_last_argument_and_all_of_it_as_json(sent, tmp_path):
    received = tmp_path / "heard"
    script = tmp_path / "keep it.py"
    script.write_text(
        "import sys, pathlib\npathlib.Path(sys.argv[1]).write_text(sys.argv[2] + sys.stdin.read())"
    )
    to = f"{sys.executable} '{script}' {received}"
    assert sent(to, lambda messages: messages.ended(RESULT, tmp_path)) == []
    words, _, content = received.read_text().partition("{")
    assert words == "aw0: fail: 1 of 1 check outside the limits"
    assert json.loads("{" + content)["verdict"] == "fail"


@pytest.mark.parametrize(
    ("to", "why"),
    [
        ("http://192.0.2.1/hook", "another machine"),
        ("https://[2001:db8::1]:8080/hook", "another machine"),
        ("http://0.0.0.0/", "another machine"),
        ("HTTP://user@192.0.2.1#127.0.0.1", "another machine"),
        ("http://", "is not an address"),
        ("http://127.0.0.1:notaport/", "is not an address"),
        ("no-such-command --to me", "there is no command 'no-such-command'"),
        ("tell 'me", "quotation mark"),
        ("   ", "there is no command"),
    ],
)
def test_an_unreachable_subscriber_is_refused_before_motion(to, why, tmp_path):
    with pytest.raises(MessageError, match=why):
        receiver(to)
    done = CliRunner().invoke(run_command, ["leak_down", "--message", to, "--out", str(tmp_path / "runs")])
    assert done.exit_code == MISUSE and why in done.stderr and not (tmp_path / "runs").exists()


def test_another_machine_is_reached_only_on_request():
    assert receiver("https://192.0.2.1/hook", elsewhere=True)


def test_a_run_tells_its_question_and_its_end(server, tmp_path):
    def fits(run):
        """Fit: ask for a plate."""
        run.check("fitted", yes_or_no(run.confirm("Fit the plate")), "1", low=0.5)

    nothing = lambda run: None  # noqa: E731
    box = QuestionBox()

    def reply():
        while not server.heard:
            time.sleep(0.01)
        box.reply("done", "A. Tester")

    thread = threading.Thread(target=reply, daemon=True)
    thread.start()
    keeping = Keeping(messages=Messages(receiver(f"http://127.0.0.1:{server.server_port}/")))
    rig = RigFile(name="here", simulation=Simulation(), time="virtual")
    plans = [plan(setup=nothing, teardown=nothing)(fits)]
    run_plans(plans, rig, tmp_path, virtual=True, seed=3, out=tmp_path, operator=box, keeping=keeping)
    thread.join(10.0)
    for one in threading.enumerate():
        if one.name == "message":
            one.join(WITHIN)
    assert [(told["event"], told["plan"]) for _, _, told in server.heard] == [
        ("question", "fits"),
        ("end", "fits"),
    ]
    assert server.heard[1][2]["verdict"] == "pass"
