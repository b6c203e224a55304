"""Step 6, the search: stepwise over the catalogue, forwards with a swap pass after each step, then backwards.

Theory of operation
-------------------
Each cause is tested together with the causes found before it, under the noise of their residual. One turn of the loop
is steps 3 to 6 of the method:

1. `trials.current_model`: noise, fit, footprints and scores around the effects accepted so far (steps 2 to 5);
2. `trials.fit_trials`: effects above the threshold are fitted and tested by the gates (`gates.py`);
3. `admission.choose`, `choose_sufficient`, `admit`: one trial enters, or two together, or none. If none enters and the
   residual is far above the noise, `try_finite_sizes` fits causes that act only temporarily, which enter in the same
   way. Otherwise the search ends;
4. `rivals.swap`: rivals are tested in place of each accepted effect.

At the end `backward.weigh` removes superfluous effects. At most ``Config.max_effects`` enter. The result depends on the
seed, not on the number of workers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from diagnosis.engine.admission import (
    admit,
    choose,
    choose_sufficient,
    choose_with_strained,
)
from diagnosis.engine.backward import weigh
from diagnosis.engine.base_model import fit_base_model
from diagnosis.engine.finite_sizes import far_above_noise, plainly, try_finite_sizes
from diagnosis.engine.gates import noise_floors
from diagnosis.engine.rivals import swap
from diagnosis.engine.search_state import Problem, SearchResult, SearchState, Trial
from diagnosis.engine.trials import current_model, fit_trials

Progress = Callable[[str, float], None]


def search(problem: Problem, progress: Progress = lambda _text, _part: None) -> SearchResult:
    """Search a catalogue for the causes of the residual that the base model leaves on the fit runs.

    ``progress`` receives the name of the present step, and the finished part of the diagnosis (0 to 1).
    """
    progress("fitting the base model", 0.0)
    state = _start(problem)
    while True:
        done = len(state.current.effects) / problem.config.max_effects
        trials: tuple[Trial, ...] = ()
        if done < 1.0:
            titles = [problem.hypotheses[name].title for name in state.current.effects]
            beside = " and ".join(f'"{title}"' for title in titles) or "the base model"
            progress(f"testing candidates in addition to {beside}", 0.1 + 0.8 * done)
            trials = fit_trials(problem, state)
        state = state.after(trials)
        chosen = choose(problem, state, trials) or choose_sufficient(problem, state, trials)
        if chosen is None and done < 1.0 and far_above_noise(state):
            progress("looking for a second cause", 0.1 + 0.8 * done)
            chosen = choose_with_strained(problem, state, trials)
        if chosen is None and done < 1.0 and far_above_noise(state):
            progress("looking for causes that act only in parts of the runs", 0.1 + 0.8 * done)
            plain = plainly(problem, state)
            trials = try_finite_sizes(problem, plain, trials)
            state = state.with_further(trials)
            chosen = choose(problem, plain, trials)
            if chosen:
                state = replace(state, current=plain.current, finite=state.finite | {chosen.effect})
        if chosen is None:
            break
        # One after the other: columns are large, and the former ones are gone before there are others.
        state = state.without_columns()
        state = admit(problem, state, chosen, trials)
        state = swap(problem, state)
    progress("checking the causes that were found", 0.9)
    return weigh(problem, state)


def _start(problem: Problem) -> SearchState:
    """Return the base model as the first state of the search."""
    replay = problem.replay
    current = current_model(problem, fit_base_model(replay))
    floors = noise_floors(replay.simulator.channels, (*replay.runs, *problem.select), current.model.noise)
    return SearchState(current, floors)
