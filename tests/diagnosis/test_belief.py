"""What is told before the verdict: base parameters that the data contradict, and every doubt of the data."""

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from astb.diagnose import show
from diagnosis.engine.belief import contradicted
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import white
from diagnosis.report.page import render


def believed(simulator, **nominal):
    """The simulator with other nominal values of its parameters."""
    return replace(
        simulator,
        nuisances=tuple(replace(n, nominal=nominal.get(n.name, n.nominal)) for n in simulator.nuisances),
    )


def fitted(laboratory, **nominal):
    lab = laboratory(samples=500)
    data = lab.measure(1)
    replay = Replay(believed(lab.simulator, **nominal), data.of("fit"), 1)
    noise = white([channel.noise for channel in data.channels])
    return fit(replay, noise, base_point(replay.simulator.nuisances, replay.names))


def test_a_parameter_far_from_what_is_believed_is_told_and_no_other(laboratory):
    assert contradicted(fitted(laboratory)) == []
    (told,) = contradicted(fitted(laboratory, stiffness=2400.0))
    assert told.startswith("stiffness was fitted as ")
    assert "20 σ from its expected value, 2400 ± 80: check the units" in told


@pytest.mark.slow
def test_doubts_and_what_was_left_out_stand_before_the_verdict_on_the_terminal_and_on_the_page(laboratory):
    lab = laboratory(samples=500)
    said, told = "columns.x.sign may be wrong", "a.csv: left out: 3 empty rows"
    data = replace(lab.measure(1), doubts=(said,), readings=(told,))
    finding = diagnose(data, believed(lab.simulator, stiffness=2400.0))
    assert finding.doubts[0] == said and finding.readings == [told]
    assert finding.doubts[1].startswith("stiffness was fitted as")
    out = io.StringIO()
    show(finding, Path("out"), Console(file=out, width=400))
    lines = out.getvalue().splitlines()
    assert lines[:2] == [told, f"doubtful: {said}"]
    assert lines[2].startswith("doubtful: stiffness was fitted as")
    page = render(finding)
    assert page.index(said) < page.index(told) < page.index('class="banner')
