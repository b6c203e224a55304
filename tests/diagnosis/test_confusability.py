"""Indistinguishable causes: predicted gaps against fitted ones, detectable sizes, runs that decide."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from astb_studies.oscillator import Oscillator
from diagnosis.contracts import DiagnosisError, Experiment
from diagnosis.engine.config import POWER95, Config
from diagnosis.engine.confusability import Company, confusability, typical, unseen
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import candidates, footprints
from diagnosis.engine.next_run import rank, sensors
from diagnosis.engine.noise import white
from diagnosis.engine.runs import measured_channels
from diagnosis.engine.screening import fit_and_screen

#: Nothing was found, and no more than the noise remains.
NONE = Company(0.0, 100, 1.0, Config())


class Bench:
    """A laboratory with the runs of one measurement, and fits to some of them."""

    def __init__(self, laboratory, seed, effects=None, runs=None):
        self.lab = laboratory()
        self.simulator = self.lab.simulator
        self.data = self.lab.measure(seed, effects)
        chosen = [r for r in self.data.runs if runs is None or r.experiment.name in runs]
        self.replay = Replay(self.simulator, tuple(chosen), 1)
        self.noise = white([c.noise for c in self.data.channels])
        self.base = fit(self.replay, self.noise, base_point(self.simulator.nuisances, self.replay.names))

    def with_effect(self, name, *values):
        coordinates = effect_coordinates(self.simulator.catalogue[name])
        start = self.base.point.extended(coordinates, values)
        return fit(self.replay, self.noise, start, self.base.linearisation)

    def screen(self, *names):
        effects = [self.simulator.catalogue[n] for n in names] or list(self.simulator.catalogue.values())
        around = footprints(self.replay, self.base.point, candidates(effects))
        screened = fit_and_screen(self.replay, around, alpha=0.01, seed=0)
        return screened.model, screened.screening


@pytest.mark.parametrize(
    ("true", "size", "other"),
    [
        ("cubic", 2e3, "coulomb"),
        ("force_gain", 4e-3, "cubic"),
        ("coulomb", 0.04, "lag"),
        ("lag", 8e-5, "coulomb"),
    ],
)
def test_predicted_gap_is_the_fitted_one(laboratory, true, size, other):
    bench = Bench(laboratory, 5, {true: {"amplitude": size}})
    _, screen = bench.screen(true, other)
    cosine = confusability(screen).cosines[0][1]
    lambda_ = screen.root_information[[c.effect.name for c in screen.candidates].index(true)] * size
    fits = {n: bench.with_effect(n, start) for n, start in ((true, size), (other, 0.0))}
    fitted = fits[other].bic - fits[true].bic
    predicted = lambda_**2 * (1 - cosine**2)
    assert lambda_ > 5
    # λ itself scatters by 1, so that λ² scatters by 2 λ.
    assert fitted == pytest.approx(predicted, abs=4 * lambda_ + 0.1 * predicted)


def test_cosines_are_cosines(laboratory):
    found = confusability(Bench(laboratory, 0).screen()[1])
    cosines = np.array(found.cosines)
    assert cosines == pytest.approx(cosines.T, abs=2e-4) and np.diag(cosines) == pytest.approx(1.0)
    assert np.all(cosines >= 0) and np.all(cosines <= 1 + 1e-9)
    pairs = {(p.first, p.second): p for p in found.pairs}
    assert pairs["maxwell", "maxwell_two"].cosine > 0.9
    assert all(p.separable == (p.bic_gap >= 10) for p in found.pairs)


@pytest.mark.slow
def test_effects_larger_than_the_smallest_detectable_are_detected(laboratory):
    model, screen = Bench(laboratory, 0).screen("cubic", "coulomb", "force_gain")
    found = {u.effect: u for u in unseen(screen, model, NONE)}
    hits = 0
    for seed in range(12):
        name = ("cubic", "coulomb", "force_gain")[seed % 3]
        _, screen = Bench(laboratory, seed, {name: {"amplitude": found[name].smallest}}).screen(
            "cubic", "coulomb", "force_gain"
        )
        hits += bool(screen.exceeding)
    assert hits >= 9  # 95 % of 12 is 11.4


def test_detectable_size_is_threshold_and_power_over_root_information(laboratory):
    model, screen = Bench(laboratory, 0).screen("cubic")
    (one,) = unseen(screen, model, NONE)
    needed = one.smallest * float(screen.root_information[0])
    assert needed == pytest.approx(screen.threshold + POWER95 + abs(float(screen.z[0])))
    assert f"{one.smallest:.3g} N/m³" in one.sentence
    # Next to a large cause, an addition of less than a small part of it may be its roughness.
    beside = replace(NONE, explained=1000.0**2)
    (more,) = unseen(screen, model, beside)
    assert more.smallest * float(screen.root_information[0]) > 0.03 * 1000.0 + POWER95
    # Where the residual exceeds the noise, the threshold is unknown.
    (unknown,) = unseen(screen, model, replace(NONE, noise_ratio=1.3))
    assert unknown.smallest is None and unknown.sentence == "the remaining error is larger than the noise"


@pytest.mark.slow
def test_a_second_detectable_cause_is_found(laboratory):
    lab = laboratory(samples=400)
    large = {"cubic": {"amplitude": 1e6}}
    config = Config(workers=1, with_panel=False)
    found = []
    for seed in range(3):
        alone = diagnose(lab.measure(seed, large), lab.simulator, config)
        assert alone.names == ("cubic",)
        content = {one.effect: one.smallest for one in alone.not_seen}
        for effect in ("coulomb", "force_gain"):
            both = large | {effect: {"amplitude": content[effect]}}
            found.append(effect in diagnose(lab.measure(seed, both), lab.simulator, config).names)
    assert sum(found) >= 5


def test_what_hides_an_effect_is_named(laboratory):
    bench = Bench(laboratory, 0)
    loose = [replace(n, spread=1e3) if n.name == "stiffness" else n for n in bench.simulator.nuisances]
    twin = replace(
        bench.simulator.catalogue["quadratic"],
        name="lost",
        amplitude=replace(bench.simulator.catalogue["force_gain"].amplitude, spread=1e-7),
    )
    tiny = {"lost": twin}
    bench.simulator = replace(bench.simulator, nuisances=tuple(loose), catalogue=tiny)
    bench.replay = Replay(bench.simulator, bench.replay.runs, 1)
    model, screen = bench.screen()
    (one,) = unseen(screen, model, NONE)
    # The oscillator knows no effect of this name: it leaves no trace, and that is said.
    assert one.smallest is None and one.visible == 0.0


def test_typical_lambda_is_that_of_a_prior_spread(laboratory):
    _, screen = Bench(laboratory, 0).screen("cubic")
    assert typical(screen)[0] == pytest.approx(screen.root_information[0] * 2e6)


@pytest.fixture(scope="module")
def ambiguous(laboratory):
    """Coulomb friction or a Maxwell branch: one slow sine cannot distinguish them."""
    bench = Bench(laboratory, 2, {"coulomb": {"amplitude": 0.05}}, runs=("slow",))
    return bench, bench.with_effect("coulomb", 0.05), bench.with_effect("maxwell", 5.0, 0.1)


def test_the_best_run_of_the_menu_decides(laboratory, ambiguous):
    bench, coulomb, maxwell = ambiguous
    before = maxwell.bic - coulomb.bic
    menu = [e for e in bench.lab.experiments() if e.name != "slow"]
    menu.append(Experiment("rest", menu[0].time, {"drive": np.zeros(menu[0].time.size)}, minutes=0.25))
    ranking = rank([coulomb, maxwell], menu)
    assert [r.per_minute for r in ranking] == sorted((r.per_minute for r in ranking), reverse=True)
    assert ranking[-1].experiment == "rest" and ranking[-1].bic_gap < 1
    best = ranking[0].experiment
    after = Bench(laboratory, 2, {"coulomb": {"amplitude": 0.05}}, runs=("slow", best))
    gap = after.with_effect("maxwell", 5.0, 0.1).bic - after.with_effect("coulomb", 0.05).bic
    assert gap > 10 and gap > before
    # The promise is made by the rivals as one run left them, so that it is only about right.
    assert 0.4 < (gap - before) / ranking[0].bic_gap < 2.5


@dataclass(frozen=True, eq=False)
class SelectiveRecords(Oscillator):
    """An oscillator of whose records every so many samples count; 0: none."""

    every: int = 1

    def counted(self, experiment, outputs):
        return (
            (np.arange(outputs.size).reshape(outputs.shape) % self.every == 0)
            if self.every
            else outputs > np.inf
        )


def test_a_run_promises_no_more_than_its_record_will_count(ambiguous):
    bench, *models = ambiguous
    best = bench.lab.experiments()[1]

    def promised(every):
        rivals = [
            replace(m, replay=replace(m.replay, simulator=SelectiveRecords(every=every))) for m in models
        ]
        return rank(rivals, [best])[0].bic_gap

    every_sample = rank(models, [best])[0].bic_gap
    assert promised(1) == pytest.approx(every_sample)
    # Fewer samples let parameters adapt as well: a part between a third and all is left.
    assert 0.2 * every_sample < promised(3) < 0.6 * every_sample
    assert promised(0) == 0.0


def test_counted_samples_are_right_with_few_measured_channels(laboratory):
    lab = laboratory()
    measured = replace(lab.measure(1), channels=(replace(lab.simulator.channels[1], resolution=1.0),))
    measured = replace(measured, runs=tuple(replace(r, outputs=r.outputs[:, 1:]) for r in measured.runs))
    (run, *_) = measured.runs
    for simulator, counts in ((SelectiveRecords(every=2), False), (lab.simulator, True)):
        _, seen = measured_channels(measured, simulator)
        counted = seen.counted(run.experiment, run.outputs)
        # Of two channels every second number is of the first.
        assert counted.shape == run.outputs.shape and (counted == counts).all()


def test_a_model_is_not_separated_from_itself(ambiguous):
    bench, coulomb, _ = ambiguous
    (again,) = rank([coulomb, coulomb], [replace(bench.lab.experiments()[1], minutes=1.0)])
    assert again.bic_gap == pytest.approx(0.0, abs=1e-6)


def test_a_menu_without_costs_is_refused(ambiguous):
    bench, coulomb, maxwell = ambiguous
    free = replace(bench.lab.experiments()[1], minutes=0.0)
    with pytest.raises(DiagnosisError, match="takes 0 minutes; the time must be positive"):
        rank([coulomb, maxwell], [free])


def test_a_drift_that_an_offset_imitates_needs_its_reference(laboratory):
    bench = Bench(laboratory, 4, {"drift": {"amplitude": 0.1}}, runs=("slow",))
    found = sensors(bench.with_effect("drift", 0.1), bench.with_effect("cubic", 0.0))
    # With a free constant, a ramp from 0 keeps a quarter of its square.
    assert [sensor.name for sensor in found] == ["force_offset"]


def test_a_simulator_may_know_the_reference(laboratory):
    class Referenced(type(laboratory().simulator)):
        @property
        def references(self):
            return {"force_offset": "unload the cell"}

    bench = Bench(laboratory, 4, {"drift": {"amplitude": 0.1}}, runs=("slow",))
    bench.replay = Replay(Referenced(), bench.replay.runs, 1)
    found = sensors(bench.with_effect("drift", 0.1), bench.with_effect("cubic", 0.0))
    assert found[0].sentence.startswith("unload the cell: ")
