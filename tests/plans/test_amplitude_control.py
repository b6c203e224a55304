"""Under amplitude control a motion has the wanted amplitude within 1 %, after at most three repetitions."""

import json
from math import tau
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from astb.cli import commands
from bench_protocol.table import TABLE
from bench_protocol.units import mm, ms
from drivers.errors import Misuse
from test_plans.analysis import first_harmonic
from test_plans.driven import Driven
from test_plans.steps.amplitude import MOST, controlled, controlled_track
from test_plans.steps.wind import fade, random_process

FREQUENCY, WANTED = 2.0, 5 * mm
TIMES = np.arange(0.0, 2.0, 0.005)
LAGS = {"platform.vertical": 12 * ms, "platform.lateral": 20 * ms}


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


class FakeTable(FakeRun):
    """A run on a platform with first-order lags, noise and a delay of 53 ms, read between its set-points."""

    STEP, BEFORE, DELAY = 0.02, 2.0, 53 * ms

    def __init__(self, *, gain=1.0, lags=LAGS, noise=4e-6, refuses=False, controls=True) -> None:
        super().__init__(None, controls=controls)
        self.gain, self.lags, self.size, self.refuses = gain, lags, noise, refuses
        self.times = self.STEP * np.arange(1401)
        self.noise = np.random.default_rng(2)
        frequency = np.fft.rfftfreq(self.times.size, self.STEP)
        density = np.where((frequency > 0.3) & (frequency < 7.5), 1e-6 / np.maximum(frequency, 0.3) ** 2, 0.0)
        draws = np.random.default_rng(1)
        self.wanted = {name: fade(self.times) * random_process(self.times, density, draws) for name in LAGS}

    def transfer(self, name, frequency):
        return self.gain / (1 + 1j * tau * frequency * self.lags[name])

    def once(self, command):
        self.commands.append(command)
        if self.refuses and len(self.commands) > 1:
            raise Misuse("beyond a limit")
        size, readings = 4096, {}
        frequency = np.fft.rfftfreq(size, self.STEP)
        for name, way in command.items():
            late = self.transfer(name, frequency) * np.exp(-1j * tau * frequency * (self.DELAY - 7 * ms))
            motion = np.fft.irfft(np.fft.rfft(way, size) * late, size)[: way.size]
            still = np.zeros(round(self.BEFORE / self.STEP))
            readings[name] = np.concatenate([still, motion])
            readings[name] += self.size * self.noise.standard_normal(readings[name].size)
        at = self.STEP * np.arange(readings[name].size) + 7 * ms
        return SimpleNamespace(times=lambda name: at, values=readings.get)

    def track(self):
        return controlled_track(self, self.times, self.wanted, list(LAGS), self.BEFORE, self.once)

    def over_closed_form(self, command, advance):
        """The least-squares ratio of command to closed form, ``advance`` s earlier, of each axis and octave."""
        frequency, found = np.fft.rfftfreq(self.times.size, self.STEP), []
        for name, way in self.wanted.items():
            closed = (
                np.fft.rfft(way) / self.transfer(name, frequency) * np.exp(-1j * tau * frequency * advance)
            )
            for low in (0.5, 1.0, 2.0, 4.0):
                octave = (frequency >= low) & (frequency < min(2 * low, 7.5))
                of = closed[octave]
                found.append(np.vdot(of, np.fft.rfft(command[name])[octave]) / np.vdot(of, of).real)
        return np.array(found)


def test_the_command_of_a_track_is_that_of_the_inverse_transfer_function():
    """Amplitude and phase of each octave within 0.5 %, at one and the same delay of both axes."""
    run = FakeTable()
    run.track()
    assert 1 <= len(run.commands) - 1 <= 3 and not run.warnings
    apart = [
        np.abs(run.over_closed_form(run.commands[-1], late) - 1).max() for late in np.arange(0, 30 * ms, 1e-4)
    ]
    assert min(apart) < 5e-3
    first = [np.abs(run.over_closed_form(run.wanted, late) - 1).max() for late in np.arange(0, 30 * ms, 1e-3)]
    assert min(first) > 0.1, "a command that was not corrected would pass"
    for one in run.driven:
        assert one.reached == pytest.approx(one.target, rel=0.01) and abs(one.phase) <= 0.01


def test_noise_of_the_readings_does_not_enter_the_command():
    """7 % of noise on a platform without error: the command of each repetition stays within 1 % of the track."""
    run = FakeTable(lags=dict.fromkeys(LAGS, 0.0), noise=1e-4)
    run.track()
    assert len(run.commands) > 1, "the noise is too small for this test"
    for command in run.commands[1:]:
        for name, way in run.wanted.items():
            assert np.std(command[name] - way) < 0.01 * np.std(way)


def test_the_command_of_a_track_is_bounded_and_a_missed_amplitude_is_a_warning():
    run = FakeTable(gain=0.5)
    run.track()
    assert len(run.warnings) == 1
    for name, way in run.wanted.items():
        assert run.commands[-1][name].std() == pytest.approx(MOST * way.std(), rel=0.01)
        assert run.commands[-1][name][0] == run.commands[-1][name][-1] == 0.0


def test_a_track_that_the_rig_refuses_keeps_the_motion_before():
    run = FakeTable(gain=0.8, refuses=True)
    found = run.track().values("platform.vertical")
    assert found.std() < 0.85 * run.wanted["platform.vertical"].std()
    assert {one.repetitions for one in run.driven} == {0} and len(run.warnings) == 1


def test_a_rig_without_amplitude_control_gets_the_track_once():
    run = FakeTable(gain=0.8, controls=False)
    run.track()
    assert run.commands == [run.wanted] and run.driven == []


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
