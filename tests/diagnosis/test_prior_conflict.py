"""Reported before the verdict: base parameters that the data contradict, and every doubt of the data."""

import io
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from rich.console import Console

from astb.diagnose import show
from astb_studies.oscillator import OSCILLATOR_EFFECTS, Oscillator
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import white
from diagnosis.engine.prior_conflict import contradicted
from diagnosis.finding import Finding
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


def test_only_a_parameter_far_from_its_prior_is_reported(laboratory):
    assert contradicted(fitted(laboratory)) == []
    (told,) = contradicted(fitted(laboratory, stiffness=2400.0))
    assert told.startswith("stiffness was fitted as ")
    assert all(one in told for one in ("20 standard deviations", "2400 ± 160 N/m"))


@dataclass(frozen=True)
class Softer(Oscillator):
    """An oscillator with a cause that changes nothing but a parameter of the base model."""

    def run(self, experiment, parameters, effects):
        share = effects.get("softer", {}).get("amplitude", 0.0)
        rest = {name: values for name, values in effects.items() if name != "softer"}
        return super().run(
            experiment, {**parameters, "stiffness": parameters["stiffness"] * (1.0 - share)}, rest
        )


@pytest.mark.parametrize(
    ("hidden", "status", "imitating"),
    [
        ({"softer": {"amplitude": 0.2}}, "suspected", "stiffness"),
        ({"cubic": {"amplitude": 1e6}}, "named", "mass"),
        ({"force_gain": {"amplitude": 0.03}}, "named", ""),
    ],
)
def test_a_cause_that_the_base_model_imitates_says_so_first(laboratory, hidden, status, imitating):
    """A name without gain on unseen runs was claimed like others."""
    softer = replace(OSCILLATOR_EFFECTS["force_gain"], name="softer", title="a softer spring")
    system = Softer(catalogue={**OSCILLATOR_EFFECTS, "softer": softer})
    lab = laboratory(system, samples=400)
    finding = diagnose(
        lab.measure(31, hidden), system, Config(workers=1, with_panel=False, effects=(*hidden,))
    )
    assert [(one.effect, one.status) for one in finding.causes] == [(name, status) for name in hidden]
    assert finding.suspected == (status == "suspected") == finding.summary.wrong.startswith("Suspected")
    assert Finding.from_json(finding.to_json()) == finding
    assert bool(imitating) == bool(finding.imitations)
    for one in finding.imitations[:1]:
        assert one.name == imitating and one.sigmas > 4.0 >= one.sigmas_after
        assert all(
            told in finding.summary.wrong for told in (imitating, f"{one.before:.4g}", f"{one.expected:.4g}")
        )


@pytest.mark.slow
def test_doubts_precede_the_verdict_and_omissions_follow_it(laboratory):
    lab = laboratory(samples=500)
    said, told = "columns.x.sign may be wrong", "a.csv: left out: 3 empty rows"
    data = replace(lab.measure(1), doubts=(said,), readings=(told,))
    finding = diagnose(data, believed(lab.simulator, stiffness=2400.0))
    assert finding.doubts[0] == said and finding.readings == [told]
    assert finding.doubts[1].startswith("stiffness was fitted as")
    out = io.StringIO()
    show(finding, Path("out"), Console(file=out, width=400))
    lines = out.getvalue().splitlines()
    assert lines[0] == f"doubtful: {said}" and lines[1].startswith("doubtful: stiffness was fitted as")
    assert lines.index(f"  data: {told}") > 2
    page = render(finding)
    assert page.index(said) < page.index('class="banner') < page.index(told)
