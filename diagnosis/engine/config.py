"""Settings of a diagnosis, and all its levels and limits, in the order of the steps that use them.

A caller may change ``Config``. The constants below it belong to the method: the rates of false alarms and of correct
names in studies/docs/diagnosis-benchmark.md hold for these numbers. After any change of a constant the rates must be
measured again.

Terms: χ² is the sum of squares of whitened residuals; *penalised* χ² adds the squares of the parameters in units of
their prior spread (minus twice the log of the posterior density, up to a constant). λ is the norm of a footprint after
a refit of the base model, in standard deviations of the noise. lpd is the log predictive density of the validation
runs.
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
#: A test of harmonics needs fewer samples, because it compares with a known sine.
LEAST_OF_A_SINE: Final = 50
#: Lags of the Ljung-Box test: a few tenths of a second at the rates of these benches.
LJUNG_BOX_LAGS: Final = 40
#: Blocks in a run, at the three scales of the test for drift.
DRIFT_BLOCKS: Final = (48, 16, 5)
#: Below this frequency in Hz, gas and rubber are slow enough for a loop to count as quasi-static.
QUASI_STATIC_HZ: Final = 0.25
#: Time constants (s) that are tried for a drift during a hold, half a decade apart.
SETTLING_S: Final = (0.3, 1.0, 3.0, 10.0, 30.0)
#: Smallest number of samples in a hold. With fewer samples an exponential cannot be distinguished from a line.
LEAST_OF_A_HOLD: Final = 200
#: Number of bins along each coordinate of a surface of the error. All bins of a coordinate hold equally many samples.
SURFACE_BINS: Final = 7
#: Smallest number of samples for the mean of one bin.
LEAST_IN_BIN: Final = 30
#: Number of blocks of a parity signal. Their means are compared.
PARITY_BLOCKS: Final = 24
#: Number of draws of the noise for the F statistic of a parity signal. They give twelve times as many means as the
#: data.
PARITY_DRAWS: Final = 12
#: Number of draws from the covariance for the uncertainty of predicted checks. They give the standard deviation to
#: about a sixth.
CHECK_DRAWS: Final = 20
#: Number of samples that a drawn autoregression skips, so that its start has no effect.
PARITY_BURN_IN: Final = 200
#: Cycles belong to one stretch if period and height differ by at most this part. The amplitudes and frequencies of a
#: plan differ by more.
SAME_CYCLE: Final = 0.05
#: Smallest share of the variance that a sine must explain if the motion is to count as a sine. For a triangle it is
#: 0.986.
SINE_SHARE: Final = 0.995
#: Smallest number of equal cycles for a test. Fewer have no scatter.
LEAST_CYCLES: Final = 3
#: An input is at rest if it stays within this part of its range in the run …
STILL_SHARE: Final = 0.01
#: … for this many seconds.
LEAST_HOLD_S: Final = 5.0

# -- step 2, base parameters, and every later fit: base_model.py, fitting/ ---------------------------------------------

#: Largest number of steps of a fit for the comparison of models. A fit that needs more is far from any other.
FIT_STEPS: Final = 30
#: Largest number of steps of the fit of the reported model.
REPORTED_FIT_STEPS: Final = 150
#: A fit ends if the next step would reduce χ² by less than this. That is far below any level that χ² is compared with.
FIT_TOLERANCE: Final = 0.01
#: The same relative to χ² beyond the noise, because finite differences do not resolve more.
FIT_RELATIVE_TOLERANCE: Final = 1e-5
#: If a step gains less than this part of the predicted decrease, its columns were poor and are computed again.
POOR_STEP: Final = 0.75
#: If a step gains this part of the predicted decrease, its columns were good. If the next step fails, it was too long.
GOOD_STEP: Final = 0.9
#: A step is taken if it gains this part of the predicted decrease.
LEAST_STEP: Final = 0.01
#: A fit gives up if a step would close less than this part of the gap to a better model.
HOPELESS_STEP: Final = 0.02
#: Better columns are computed only if the predicted decrease of χ² is at least this.
WORTH_NEW_COLUMNS: Final = 1.0
#: If a step fails with at least this damping, the columns of the nuisances are computed again.
DOUBTFUL_DAMPING: Final = 0.01
#: Broyden's rule is applied only if the parameters of effects make at least this part of the squared step.
BROYDEN_SHARE: Final = 0.01
#: If the differences on both sides of a point differ by more than this part of their square, the reason is a jump and
#: not curvature.
SPOILT: Final = 1e-4
#: The same for footprints with a step and with half of it, relative to the square of the projected footprint.
SPOILT_FOOTPRINT: Final = 0.1
#: Eigenvalues below this part of the largest one are rounding errors. It is some hundred times the precision of a
#: double.
EIGENVALUE_FLOOR: Final = 1e-13
#: Part of the square of a column that must remain after a projection. Difference quotients have single precision and
#: are accurate to about four digits.
VISIBLE_PART: Final = 1e-8
#: Weight of the information on effects that stay fixed while a surface is fitted.
FIXED_WEIGHT: Final = 1e4
#: Weight of an uninformative prior, per square of the parameter's scale: it makes the evidence finite.
FLAT_WEIGHT: Final = 1e-6

# -- step 3, the noise: noise.py, noise_estimate.py, whitening.py ------------------------------------------------------

#: Highest order of the autoregression. BIC may choose a lower one.
AR_ORDER: Final = 10
#: Autocorrelations below this count as 0.
FORGOTTEN: Final = 1e-3
#: Number of further predecessors for the prediction of a sample if some are missing.
BRIDGED_GAP: Final = 4
#: The noise of a channel is assumed to be at least this part of the value in its data sheet, which is an upper bound.
LEAST_OF_DATA_SHEET: Final = 0.5
#: Smallest number of pairs of samples for a lag, per order of the autoregression.
PAIRS_PER_ORDER: Final = 20
#: Number of blocks, over all runs together, for the scatter of the scores. Each is far longer than the correlation time
#: of the noise.
DISPERSION_BLOCKS: Final = 256

# -- steps 4 and 5, scores and their threshold: footprints.py, screening.py, threshold.py ------------------------------

#: Number of draws of the largest score by chance, in each of two rounds. In the second round all draws are near the
#: quantile, so it scatters by only 0.002, as with some five million plain draws.
THRESHOLD_DRAWS: Final = 6_000
#: How far the level of the second round is below the quantile of the first. The first quantile scatters by a fifth of
#: this.
THRESHOLD_MARGIN: Final = 0.1

# -- step 6, fit and gates: trials.py, gates.py, family.py, admission.py, rivals.py, backward.py -----------------------

#: Number of the best scores whose confusers and richer relatives are also tried.
WITH_RELATIVES: Final = 2
#: χ² of two standard deviations of one parameter. A range is violated if more than this would be gained beyond its end.
#: If even the shortest step of a fit fails, the fit has converged if its predicted decrease is smaller than this.
TWO_SIGMA_CHI2: Final = 4.0
#: A base parameter may move this many prior standard deviations from its nominal value …
STRAINED_PRIOR: Final = 4.0
#: … or this many further than in the model without the cause. Beyond both, the cause is unphysical.
FURTHER_STRAIN: Final = 1.0
#: A base parameter this many prior standard deviations from its nominal value makes every named cause doubtful. The
#: report prints this before the verdict.
CONTRADICTED_PRIOR: Final = 10.0
#: A noise floor is known to about a tenth, and the replay of a measured motion adds a tenth on a sound bench: together
#: a quarter in squares. Below it there is no misfit that a cause could explain.
FLOOR_SLACK: Final = 1.25
#: Number of consecutive samples at rest that determine the noise.
LEAST_AT_REST: Final = 50
#: Number of rivals that are tried instead of each accepted effect.
RIVALS: Final = 4
#: Number of candidates, each unphysical alone, that are tried in pairs.
PAIRED: Final = 4
#: A trial that passes the gates must gain at least this part of the BIC that the best unphysical trial gains.
SUBSTITUTE: Final = 0.1
#: A rival must gain this part of the BIC that the accepted effect gains.
COMPARABLE: Final = 0.5
#: Finite amplitudes for the simulation of effects with low scores, relative to the expected one: finite_sizes.py.
SIZES: Final = (0.2, 1.0, 5.0)
#: Number of the most promising candidates of finite_sizes.py that are fitted.
FINITE_FITS: Final = 3
#: If a finite amplitude changes the outputs by this many times all errors, the simulation diverges.
LARGEST_CHANGE: Final = 1e3

# -- step 7, unknown terms: unknown.py ---------------------------------------------------------------------------------

#: A surface differs from 0 where its coefficients are this many standard deviations from 0 …
CLEAR_COEFFICIENT: Final = 2.0
#: … and larger than this part of the largest ones.
LARGE_COEFFICIENT: Final = 0.25

# -- step 8, the verdict: verdict.py, constancy.py ---------------------------------------------------------------------

#: A significant remainder belongs to the verdict if it is at least this part of the χ² that the causes explain.
REMAINDER: Final = 0.01
#: A surface that predicts the validation runs no better is reported only if its p-value is below this.
UNKEPT_SURFACE_P: Final = 1e-6
#: Part of its gain that a cause must keep together with a surface that imitates it. A stop that was called a cubic
#: spring kept a hundredth; measured friction with the correct name kept three to seven hundredths.
GAIN_WITH_SURFACE: Final = 0.02
#: A surface imitates an effect if it removes this part of the information on the amplitude.
IMITATED_INFORMATION: Final = 0.9
#: Factor by which a surface may exceed its prior spread in the comparison with a cause.
WIDER_SURFACE: Final = 10.0
#: An amplitude saturates if its λ is more than this many times the value expected from its standard deviation.
SATURATED: Final = 2.0
#: Numbers of stretches per run (whole runs, halves, quarters, eighths) in which a cause must be constant: constancy.py.
STRETCHES: Final = (1, 2, 4, 8)
#: False-positive probability of the constancy test; it can only remove the name of a cause that is hardly visible.
CONSTANCY_ALPHA: Final = 0.05
#: A stretch does not separate a cause from its imitation if an eigenvalue is below this part of the largest one.
#: Difference quotients are not more exact.
LEAST_EIGENVALUE: Final = 1e-6
#: λ of a named cause must be this many times the λ of the errors of the equations in its directions. For oscillators
#: with other equations, false causes reached at most 2.4. For true causes with a roughness of a fiftieth, on
#: oscillators and benches, it was at least 8.
CLEAR_OF_FORM: Final = 3.0
#: A cause is not due to errors of the equations if its remaining error on the validation runs (RMS over all channels,
#: relative) is below this. Friction of seals leaves 0.18, however rough its own law; false causes of oscillators with
#: other equations leave 0.3 to 1.
PREDICTED_SHARE: Final = 0.25
#: An error on the test runs is reported from this multiple of the noise on.
NOISE_RATIO_SHOWN: Final = 1.2
#: If a model leaves more than this multiple of the noise on unseen runs, a further cause is missing …
REMAINDER_RATIO: Final = 2.0
#: … and if it leaves more than this part of the error, the named effect is only similar to the cause.
RELATIVE: Final = 0.5
#: A cause that removes less than this part of the error on unseen runs counts as without gain, unless the log density
#: of the validation runs rises by half of `DISTINGUISHED`.
NO_GAIN: Final = 0.01
#: A smaller part of the error than this is reported as a small gain.
GAINS_LITTLE: Final = 0.1
#: If more than the noise remains, a rival predicts unseen runs as well as the cause if its error is at most this
#: multiple of that of the cause.
PREDICTS_AS_WELL: Final = 1.01

# -- the intervals: model_error.py, intervals.py -----------------------------------------------------------------------

#: Smallest number of records, or runs, whose scatter is used as the uncertainty of a parameter. The scatter of fewer is
#: too uncertain. With fewer test runs, the bootstrap of the gain draws blocks of runs instead of runs.
LEAST_REPEATS: Final = 6
#: Number of values of τ (the size of an error of the model) that are tried. Small values are closer to each other.
SPREADS_TRIED: Final = 2000
#: A direction of a surface is used for τ only if its information, for coefficients of the prior spread, is this many
#: times the noise.
SHOWN_INFORMATION: Final = 100.0
#: Factor from the excess of χ² of a varying cause to the additional variance of its amplitude. Of 46 causes that were
#: rightly named on oscillators with other equations, the intervals contain the true value for 45 (also with a factor
#: four times as large), and for 38 without it.
OWED_TO_INTERVAL: Final = 0.25
#: If χ² at the end of an interval differs by more than this part from the parabola, the end is searched on χ² …
BENT: Final = 0.2
#: … with at most this many fits.
PROFILE_STEPS: Final = 6

# -- what was not seen, and what would decide: confusability.py, next_run.py -------------------------------------------

#: Pairs of footprints with a smaller cosine are not reported.
WORTH_A_LINE: Final = 0.8
#: If λ exceeds the threshold by this (one-sided normal quantile), the score exceeds the threshold in 95 % of cases.
POWER95: Final = 1.6449
#: An effect is hidden if less than this part of its footprint remains after projection on the base model.
HIDDEN_FOOTPRINT: Final = 0.3
#: A calibration is reported if it increases the BIC gap by this factor.
WORTH_A_REFERENCE: Final = 2.0
#: Largest number of calibrations that are reported.
MOST_REFERENCES: Final = 3

# -- step 9, the gain: gain.py -----------------------------------------------------------------------------------------

#: Nominal levels of the predicted intervals whose coverage is tested.
COVERAGE_LEVELS: Final = (0.50, 0.90, 0.95)
#: Number of draws of the bootstrap. Each end of the 95 % interval has 50 draws beyond it.
BOOTSTRAPS: Final = 2000
#: Number of blocks in a run for the bootstrap. They are seconds long, far longer than the correlation time of the
#: noise.
BOOTSTRAP_BLOCKS: Final = 24
#: An error that exceeds the noise by a smaller factor counts as noise.
EXPLAINABLE: Final = 1.05

# -- identification, which asks for no cause: identify.py --------------------------------------------------------------

#: A parameter is identified, and a place of a surface was visited, if the standard deviation after the fit is less than
#: this part of that of the prior.
IDENTIFIED: Final = 0.5

# -- the contract of a simulator: contract_check.py, simulation.py, prior_conflict.py ---------------------------------

#: Largest number of samples that the check of the contract simulates.
CHECKED_SAMPLES: Final = 1000
#: A parameter without a bound is tried up to this many prior standard deviations. It is also the largest assumed
#: amplitude.
FAR: Final = 5.0
#: Allowed deviation of the effect of small amplitudes from proportionality, relative to the size of the outputs.
CURVED: Final = 0.1
#: Rounding error of differences, relative to the size of the outputs.
ROUNDING: Final = 1e-12
#: Size of a parameter without a prior, as a multiple of its difference step.
STEPS_OF_SIZE: Final = 100.0
#: Number of parameters reported with an error; those that differ from their nominal values come first.
PARAMETERS_SHOWN: Final = 12
#: Number of base parameters far from their priors that are reported, the furthest first.
PRIORS_SHOWN: Final = 3

# -- goodness of fit: goodness.py --------------------------------------------------------------------------------------

#: Blocks of a run whose means are compared to detect a walk.
WALK_BLOCKS: Final = 12
#: Half the bandwidth of the test for lines, in ordinates of the periodogram (usual values are 2 to 4).
TIME_BANDWIDTH: Final = 4
#: An error is called a line or a walk if this explains at least this share of the excess above the noise.
MOST_OF_EXCESS: Final = 0.8

# -- jobs for a simulator: fitting/replay.py ---------------------------------------------------------------------------

#: Largest number of jobs that a simulator receives at once. With more, some workers would be idle at the end.
MOST_BATCH: Final = 128
#: If a run needs at least this many differences, an approximate simulation of their common start saves time.
LEAST_ROUGH: Final = 4

# -- memory: memory.py -------------------------------------------------------------------------------------------------

#: Arrays of columns with at least this many pages get separate pages. For smaller arrays the pages would be half empty.
OWN_PAGES: Final = 64
