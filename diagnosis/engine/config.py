"""Settings of a diagnosis, and all its levels and limits, in the order of the steps that use them.

A caller may change ``Config``. The constants below it belong to the method: the rates of false alarms and of correct
names in studies/docs/diagnosis-benchmark.md hold for these numbers. After any change of a constant the rates must be
measured again.

Terms: χ² is the sum of squares of whitened residuals; *penalised* χ² adds the squares of the parameters in units of
their prior spread (minus twice the log of the posterior density, up to a constant). λ is the norm of a footprint after
a refit of the base model, in standard deviations of the noise. lpd is the log predictive density of the select runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

#: BIC gap, or twice the gap of log densities, from which on two causes are distinguished.
DISTINGUISHED: Final = 10.0


@dataclass(frozen=True, slots=True)
class Config:
    """Options of a diagnosis that the caller may change. The published rates were measured with the defaults."""

    alpha: float = (
        0.003  #: step 5: probability that any score exceeds the threshold in data that hold nothing
    )
    alpha_unknown: float = 0.002  #: step 7: the same for the omnibus test of unknown terms
    seed: int = 1
    workers: int = 2
    max_effects: int = 3  #: step 6: largest number of causes
    fits: int = 8  #: step 6: number of hypotheses that are fitted at each forward step, by highest score
    effects: tuple[str, ...] | None = None  #: only these of the catalogue; None: all
    ambiguous: float = DISTINGUISHED  #: steps 6 and 8: BIC gap under which two causes are not distinguished
    lpd_loss: float = 3.0  #: step 6: largest loss of log predictive density by a cause
    rough: float = 0.03  #: step 6: part of the λ found before that a further cause must exceed
    gain: float = 0.05  #: step 6: least part of the explainable RMSE that a cause must explain
    with_panel: bool = True  #: step 1: whether the panel of tests is computed; no verdict depends on it
    with_gain: bool = True  #: step 9: whether the gain is computed; the verdict is the same


# -- step 1, the residual: residual/ -----------------------------------------------------------------------------------

#: False discovery rate of the panel (Benjamini and Hochberg). One false row in a hundred is acceptable, because the
#: panel names no cause.
PANEL_FDR: Final = 0.01
#: Number of samples that a test of a whole run needs for its asymptotic distribution.
LEAST_SAMPLES: Final = 100
#: A test of harmonics needs fewer: it compares with a sine that is known.
LEAST_OF_A_SINE: Final = 50
#: Lags of the Ljung-Box test: a few tenths of a second at the rates of these benches.
LJUNG_BOX_LAGS: Final = 40
#: Blocks in a run, at the three scales of the test for drift.
DRIFT_BLOCKS: Final = (48, 16, 5)
#: Below this frequency in Hz, gas and rubber are slow enough for a loop to count as quasi-static.
QUASI_STATIC_HZ: Final = 0.25
#: Time constants in s of what may settle during a hold, half a decade apart.
SETTLING_S: Final = (0.3, 1.0, 3.0, 10.0, 30.0)
#: Samples in a hold without which an exponential is not distinguished from a line.
LEAST_OF_A_HOLD: Final = 200
#: Bins along each side of a surface of the error, equally filled along each coordinate.
SURFACE_BINS: Final = 7
#: Samples that the mean of one bin needs.
LEAST_IN_BIN: Final = 30
#: Blocks of a parity signal, whose means are compared.
PARITY_BLOCKS: Final = 24
#: Draws of the noise that the F statistic of a parity signal is compared with: twelve times as many means.
PARITY_DRAWS: Final = 12
#: Draws from the covariance for the uncertainty of predicted checks: they give a standard deviation to a sixth.
CHECK_DRAWS: Final = 20
#: Samples that a drawn autoregression runs before its first one counts, so that it has forgotten its start.
PARITY_BURN_IN: Final = 200
#: Cycles belong to one stretch while period and height agree within this part: an amplitude or frequency of a plan
#: differs from the next by more.
SAME_CYCLE: Final = 0.05
#: Share of the variance that a sine must explain to be taken for one; a triangle's fundamental explains 0.986.
SINE_SHARE: Final = 0.995
#: Fewer equal cycles than this have no scatter from which a test could be made.
LEAST_CYCLES: Final = 3
#: An input holds still while it stays within this part of its range in the run …
STILL_SHARE: Final = 0.01
#: … for this many seconds.
LEAST_HOLD_S: Final = 5.0

# -- step 2, base parameters, and every later fit: base_model.py, fitting/ ---------------------------------------------

#: Steps that a fit may take while models are compared: a fit that needs more is far from any other.
FIT_STEPS: Final = 30
#: Steps of the model that is reported.
REPORTED_FIT_STEPS: Final = 150
#: A fit ends where the next step would lower χ² by less than this: far below any level that χ² is compared with.
FIT_TOLERANCE: Final = 0.01
#: Relative tolerance at which the fit stops, per unit of χ² beyond the noise: finite differences resolve no more.
FIT_RELATIVE_TOLERANCE: Final = 1e-5
#: A step that gains less than this part of the predicted decrease was taken with poor columns: they are computed again.
POOR_STEP: Final = 0.75
#: A step that gains this part of the predicted decrease had good columns: a failure after it is one of length.
GOOD_STEP: Final = 0.9
#: A step is taken if it gains this part of the predicted decrease.
LEAST_STEP: Final = 0.01
#: A fit gives up where a step would close less than this part of its gap to a better model.
HOPELESS_STEP: Final = 0.02
#: Better columns are not worth their simulations for a predicted decrease of χ² below this.
WORTH_NEW_COLUMNS: Final = 1.0
#: If a step fails with at least this damping, the columns of the nuisances are computed again.
DOUBTFUL_DAMPING: Final = 0.01
#: Part of a squared step that the effects' own parameters must make for Broyden's rule to learn from it.
BROYDEN_SHARE: Final = 0.01
#: Differences on both sides of a point that are apart by this part of their square are apart by more than curvature.
SPOILT: Final = 1e-4
#: The same for footprints at a step and at half of it, as a part of the square of the projected footprint.
SPOILT_FOOTPRINT: Final = 0.1
#: Part of the largest eigenvalue below which one is rounding: some hundred times the precision of a double.
EIGENVALUE_FLOOR: Final = 1e-13
#: Part of the square of a column that must be left after a projection: difference quotients, kept in single precision,
#: are right to about four digits.
VISIBLE_PART: Final = 1e-8
#: Weight of the information on effects that stay fixed while a surface is fitted.
FIXED_WEIGHT: Final = 1e4
#: Weight of an uninformative prior, per square of the parameter's scale: it makes the evidence finite.
FLAT_WEIGHT: Final = 1e-6

# -- step 3, the noise: noise.py, noise_estimate.py, whitening.py ------------------------------------------------------

#: Highest order of the autoregression; BIC takes fewer.
AR_ORDER: Final = 10
#: Autocorrelations below this count as none.
FORGOTTEN: Final = 1e-3
#: Number of further predecessors for the prediction of a sample if some are missing.
BRIDGED_GAP: Final = 4
#: No channel is assumed to have less noise than this part of its data sheet's value, which is an upper bound.
LEAST_OF_DATA_SHEET: Final = 0.5
#: Pairs of samples that a lag needs for each order of the autoregression.
PAIRS_PER_ORDER: Final = 20
#: Blocks of all runs together over which scores scatter: each is far longer than the noise remembers.
DISPERSION_BLOCKS: Final = 256

# -- steps 4 and 5, scores and their threshold: footprints.py, screening.py, threshold.py ------------------------------

#: Draws of the largest of all scores under chance, in each of two rounds. All of the second are about as rare as what
#: is looked for: the quantile scatters by 0.002, as it would with some five million plain draws.
THRESHOLD_DRAWS: Final = 6_000
#: Distance of the second round below the quantile of the first, which scatters by a fifth of it.
THRESHOLD_MARGIN: Final = 0.1

# -- step 6, fit and gates: trials.py, gates.py, family.py, admission.py, rivals.py, backward.py -----------------------

#: Number of the best scores whose confusers and richer relatives are also tried.
WITH_RELATIVES: Final = 2
#: χ² of two standard deviations of one parameter. A range is violated if more would be gained beyond its end; where no
#: step of a fit is short enough, the fit has converged if its predicted decrease is smaller.
TWO_SIGMA_CHI2: Final = 4.0
#: A base parameter this many prior standard deviations from its nominal value is no longer assumed …
STRAINED_PRIOR: Final = 4.0
#: … and a cause is blamed for it if it needs this many more than the model without it.
FURTHER_STRAIN: Final = 1.0
#: From this number on every named cause is doubtful; the report prints this before the verdict.
CONTRADICTED_PRIOR: Final = 10.0
#: A noise floor is known to about a tenth, and the replay of a measured motion leaves a tenth more of a sound bench: in
#: squares, together a quarter. Below it there is no misfit of which a cause could be asked to explain a part.
FLOOR_SLACK: Final = 1.25
#: Number of consecutive samples at rest that determine the noise.
LEAST_AT_REST: Final = 50
#: Number of rivals that are tried instead of each accepted effect.
RIVALS: Final = 4
#: Number of causes, each unphysical alone, that are tried in pairs.
PAIRED: Final = 4
#: What passes the gates must gain this part of the BIC that the best unphysical trial gains, or it is no substitute.
SUBSTITUTE: Final = 0.1
#: A rival must gain this part of the BIC that the accepted effect gains.
COMPARABLE: Final = 0.5
#: Finite amplitudes, in expected ones, for the simulation of effects with low scores: finite_sizes.py.
SIZES: Final = (0.2, 1.0, 5.0)
#: Number of the most promising candidates there that are fitted.
FINITE_FITS: Final = 3
#: An effect that changes the outputs by this many times all errors diverges there.
LARGEST_CHANGE: Final = 1e3

# -- step 7, unknown terms: unknown.py ---------------------------------------------------------------------------------

#: A surface acts where its coefficients are this many standard deviations from 0 …
CLEAR_COEFFICIENT: Final = 2.0
#: … and such a part of the largest ones.
LARGE_COEFFICIENT: Final = 0.25

# -- step 8, the verdict: verdict.py, constancy.py ---------------------------------------------------------------------

#: Part of the χ² explained by the causes from which on a significant rest belongs to the verdict.
REMAINDER: Final = 0.01
#: A surface that predicts the select runs no better is reported only if its p-value is below this.
UNKEPT_SURFACE_P: Final = 1e-6
#: Part of what a cause gains that it must still gain together with a surface which imitates it. A stop that was called
#: a cubic spring kept a hundredth, measured friction under its right name three to seven.
GAIN_WITH_SURFACE: Final = 0.02
#: Part of the information on an amplitude that a surface must take away to imitate the effect.
IMITATED_INFORMATION: Final = 0.9
#: Factor by which a surface may exceed its assumed size together with a cause.
WIDER_SURFACE: Final = 10.0
#: An amplitude saturates where its absence costs so many times the root of χ² that its standard deviation promises.
SATURATED: Final = 2.0
#: Whole runs, halves, quarters and eighths are tested for a constant cause: constancy.py.
STRETCHES: Final = (1, 2, 4, 8)
#: False-positive probability of the constancy test; it can only remove the name of a cause that is hardly visible.
CONSTANCY_ALPHA: Final = 0.05
#: Part of the largest eigenvalue below which a stretch does not separate a cause from its imitation. Difference
#: quotients are not more exact.
LEAST_EIGENVALUE: Final = 1e-6
#: λ of a named cause must be so many times the λ of what the model's form owes in the cause's own directions. Of
#: oscillators of another form, clear false causes reached 2.4 times at most; of true causes under a roughness of a
#: fiftieth, on oscillators and benches, none stayed below eight times.
CLEAR_OF_FORM: Final = 3.0
#: Largest residual on the select runs (RMS over all channels, relative) of a cause that is not due to model form error.
#: Friction of seals leaves 0.18 there, however rough its own law; false causes of oscillators of another form 0.3 to 1.
PREDICTED_SHARE: Final = 0.25
#: Multiple of the noise on the report runs that is worth a sentence.
NOISE_RATIO_SHOWN: Final = 1.2
#: A model that leaves more than so many times the noise on unseen runs lacks a further cause …
REMAINDER_RATIO: Final = 2.0
#: … and if more than this part of the error is left, the named effect is only similar to the cause.
RELATIVE: Final = 0.5
#: A cause that removes less than this part of the error on unseen runs gains nothing there, unless the log density of
#: the select runs rises by half of `DISTINGUISHED`.
NO_GAIN: Final = 0.01
#: A smaller part of the error than this is reported as a small gain.
GAINS_LITTLE: Final = 0.1
#: Where more than the noise is left, a rival that leaves at most so many times the error of the cause on unseen runs
#: predicts them as well.
PREDICTS_AS_WELL: Final = 1.01

# -- the intervals: model_error.py, intervals.py -----------------------------------------------------------------------

#: Records, or runs, whose scatter states how uncertain a number is: with fewer, the scatter is itself too uncertain.
#: With fewer report runs, the bootstrap of the gain draws blocks of runs instead of runs.
LEAST_REPEATS: Final = 6
#: Spreads of a model's own error that are tried, closer to each other where they are small.
SPREADS_TRIED: Final = 2000
#: Information per unit of noise, for coefficients as large as is assumed, from which on a direction reports of them.
SHOWN_INFORMATION: Final = 100.0
#: Variances of a cause's amplitude for each unit of χ² that the form of the model owes in its directions. Of 46 causes
#: rightly named on oscillators of another form intervals hold 45 with it, as with four times as much, and 38 without.
OWED_TO_INTERVAL: Final = 0.25
#: Where χ² at the end of an interval differs by more than this part from the parabola, the valley bends …
BENT: Final = 0.2
#: … and its own end is sought with at most so many fits.
PROFILE_STEPS: Final = 6

# -- what was not seen, and what would decide: confusability.py, next_run.py -------------------------------------------

#: Pairs of footprints with a smaller cosine are not worth a line.
WORTH_A_LINE: Final = 0.8
#: The score exceeds the threshold in 95 % of cases where λ lies above it by this (one-sided normal quantile).
POWER95: Final = 1.6449
#: An effect is hidden where less than this part of its footprint is left together with the base model.
HIDDEN_FOOTPRINT: Final = 0.3
#: A reference is worth naming if it makes the gap grow by this factor.
WORTH_A_REFERENCE: Final = 2.0
#: Largest number of references that are named.
MOST_REFERENCES: Final = 3

# -- step 9, the gain: gain.py -----------------------------------------------------------------------------------------

#: Nominal levels of the predicted intervals whose coverage is tested.
COVERAGE_LEVELS: Final = (0.50, 0.90, 0.95)
#: Draws of the bootstrap: the ends of the 95 % interval rest on 50 of them.
BOOTSTRAPS: Final = 2000
#: Blocks in a run for the bootstrap: seconds long, so that the memory of the noise stays inside.
BOOTSTRAP_BLOCKS: Final = 24
#: A misfit that exceeds the noise by a smaller factor leaves nothing to explain.
EXPLAINABLE: Final = 1.05

# -- identification, which asks for no cause: identify.py --------------------------------------------------------------

#: A parameter is identified, and a place of a surface was visited, where the data leave less than this part of the
#: standard deviation that was assumed.
IDENTIFIED: Final = 0.5

# -- the contract of a simulator: contract_check.py, simulation.py, prior_conflict.py ---------------------------------

#: Largest number of samples that are simulated.
CHECKED_SAMPLES: Final = 1000
#: Prior deviations to which a parameter without a bound is tried, and the largest amplitude that is assumed.
FAR: Final = 5.0
#: Allowed deviation of small amplitudes from proportionality, in units of the outputs' size.
CURVED: Final = 0.1
#: The rounding of differences, in units of the outputs' size.
ROUNDING: Final = 1e-12
#: Size of a parameter without a prior, in steps of its differences.
STEPS_OF_SIZE: Final = 100.0
#: Number of parameters reported with an error; those that differ from their nominal values come first.
PARAMETERS_SHOWN: Final = 12
#: Number of base parameters far from their priors that are reported, the furthest first.
PRIORS_SHOWN: Final = 3

# -- goodness of fit: goodness.py --------------------------------------------------------------------------------------

#: Blocks of a run whose means are compared to detect a walk.
WALK_BLOCKS: Final = 12
#: Ordinates of the periodogram on each side of a line that are its background; fewer than the least are too few.
LINE_NEIGHBOURS: Final = 24
LEAST_LINE_NEIGHBOURS: Final = 4
#: Share of the excess above the noise from which an error is called a line or a walk.
MOST_OF_EXCESS: Final = 0.8

# -- jobs for a simulator: fitting/replay.py ---------------------------------------------------------------------------

#: Most jobs that a simulator is given at once: of more the last batches would not keep all workers busy.
MOST_BATCH: Final = 128
#: Differences in one run from which on a rough simulation of where they begin pays.
LEAST_ROUGH: Final = 4

# -- memory: memory.py -------------------------------------------------------------------------------------------------

#: Arrays of columns of at least so many pages get separate pages; those of smaller arrays would be half empty.
OWN_PAGES: Final = 64
