"""Under amplitude control the motion of a wave has the wanted amplitude within 1 %, after at most three repetitions."""

import json
from math import tau
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from astb.cli import commands
from bench_protocol.table import TABLE
from bench_protocol.units import mm
from drivers.errors import Misuse
from test_plans.analysis import first_harmonic
from test_plans.driven import Driven
from test_plans.steps.amplitude import MOST, controlled

FREQUENCY, WANTED = 2.0, 5 * mm
TIMES = np.arange(0.0, 2.0, 0.005)


class FakeRun:
    """A run on an axis whose amplitude is ``answer`` of the command."""

    def __init__(self, answer, *, controls: bool = True) -> None:
        self.bench = SimpleNamespace(amplitude_control=controls, table=TABLE)
        self.answer, self.commands, self.warnings = answer, [], []
        self.driven: list[Driven] = []
        self.say = lambda text: None
        self.warn = self.warnings.append

    def wave(self, form: str = "sine") -> float:
        shape = np.sin(tau * FREQUENCY * TIMES)
        if form == "triangle":
            shape = 2 / np.pi * np.arcsin(shape)

        def once(command: float):
            self.commands.append(command)
            return TIMES, {"motion": self.answer(command) * shape}

        moved = controlled(
            self, "vertical", form, FREQUENCY, WANTED, once,
            lambda times, values: first_harmonic(times, values["motion"], FREQUENCY),
        )  # fmt: skip
        return float(np.abs(moved[1]["motion"]).max())


@pytest.mark.parametrize("form", ["sine", "triangle"])
@pytest.mark.parametrize("gain", [0.7, 0.9, 0.988, 1.2])
def test_one_repetition_is_exact_for_a_linear_axis(form, gain):
    run = FakeRun(lambda command: gain * command)
    # The first harmonic of a sampled triangle is that of the continuous one within 0.1 %.
    assert run.wave(form) == pytest.approx(WANTED, rel=2e-3)
    assert run.commands == pytest.approx([WANTED, WANTED / gain], rel=2e-3)
    assert run.driven[-1].repetitions == 1 and not run.warnings


def test_an_axis_with_saturation_converges_within_three_repetitions():
    run = FakeRun(lambda command: 20 * mm * np.tanh(command / (22 * mm)))
    assert run.wave() == pytest.approx(WANTED, rel=0.01)
    assert 1 <= run.driven[-1].repetitions <= 3 and not run.warnings


def test_the_next_wave_of_this_kind_begins_with_the_corrected_command():
    run = FakeRun(lambda command: 0.9 * command)
    run.wave()
    run.wave()
    assert run.commands == pytest.approx([WANTED, WANTED / 0.9, WANTED / 0.9])
    assert [one.repetitions for one in run.driven] == [1, 0]


def test_the_command_is_bounded_and_a_missed_amplitude_is_a_warning():
    run = FakeRun(lambda command: 0.4 * command)
    run.wave()
    assert run.commands == pytest.approx([WANTED, MOST * WANTED])
    assert len(run.warnings) == 1


def test_a_command_that_the_rig_refuses_keeps_the_motion_before():
    def answer(command: float) -> float:
        if command > 1.05 * WANTED:
            raise Misuse("beyond a limit")
        return 0.9 * command

    run = FakeRun(answer)
    assert run.wave() == pytest.approx(0.9 * WANTED)
    assert run.driven[-1].command == WANTED and len(run.warnings) == 1


def test_a_rig_without_amplitude_control_gets_the_wanted_command_once():
    run = FakeRun(lambda command: 0.9 * command, controls=False)
    run.wave()
    assert run.commands == [WANTED] and run.driven == []


@pytest.mark.slow
def test_slow_actuators_reach_the_amplitude_as_by_hand(tmp_path):
    """The reached amplitudes, and the command that a second run by hand would have: wanted² over reached."""

    def tables(control: bool) -> dict[str, list[float]]:
        folder = tmp_path / f"rig_{control}"
        folder.mkdir()
        text = f'name = "rig"\ntime = "virtual"\namplitude_control = {str(control).lower()}\n'
        text += '[simulation.effects]\nactuator_tracking = "-75 %"\n'
        (folder / "rig.toml").write_text(text)
        words = ["run", "dynamic_stiffness", "--rig", str(folder), "--out", str(folder / "runs")]
        CliRunner().invoke(commands, words)
        result = json.loads((folder / "runs/dynamic_stiffness/result.json").read_bytes())
        found = {one["name"]: one["ys"] for one in result["curves"] if one["group"].endswith("sine of 5 mm")}
        return found

    assert tables(False) == {}
    found = tables(True)
    np.testing.assert_allclose(found["reached"], WANTED, rtol=0.01)
    assert max(found["commanded"]) > 1.01 * WANTED or min(found["commanded"]) < 0.99 * WANTED
