"""The sequential test: it gives no alarm while the model holds, and one soon after it does not."""

import numpy as np
import pytest

from diagnosis.twin.detector import BETWEEN, MOST, Detector, likelihood_ratios

BLOCK = 0.5


def white(seed: int, blocks: int, channels: int = 6, bins: int = 10) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(blocks, channels, bins))


def test_likelihood_ratios_have_mean_one_at_most_while_the_model_holds():
    ratios = np.exp(likelihood_ratios(white(1, 20_000)))
    deviation = ratios.std(axis=(0, 1)) / np.sqrt(ratios.shape[0] * ratios.shape[1])
    assert (ratios.mean(axis=(0, 1)) < 1.0 + 4.0 * deviation).all()
    assert ratios.max() <= np.exp(MOST) * (1 + 1e-12)


@pytest.mark.slow
def test_a_hundred_hours_of_a_sound_rig_give_hardly_an_alarm():
    # The mean length between two alarms is more than 100 h: of 100 h at most two thirds would have one, if it were
    # that short. It is much longer, since the bound is not sharp.
    alarms = 0
    detector = Detector(6, BLOCK)
    for seed in range(36):
        alarm = detector.look(white(seed, round(BETWEEN / BLOCK / 36)))
        alarms += alarm is not None
        if alarm is not None:
            detector = Detector(6, BLOCK)
    assert alarms <= 1


@pytest.mark.parametrize(
    ("change", "within"),
    [(lambda z: z + 3.0 / np.sqrt(10), 14), (lambda z: z - 4.0 / np.sqrt(10), 9), (lambda z: 3.0 * z, 9)],
)
def test_a_change_in_one_channel_is_detected_with_its_start(change, within):
    z = white(7, 400)
    z[200:, 3] = change(z[200:, 3])
    alarm = Detector(6, BLOCK).look(z)
    assert alarm is not None
    assert 200 <= alarm.at <= 200 + within
    assert abs(alarm.since - 200) <= 3
    assert alarm.channel == 3


def test_missing_readings_support_no_conclusion():
    z = white(3, 50)
    z[:, 2] = np.nan
    assert (likelihood_ratios(z)[:, 2] == 0.0).all()


def test_one_odd_block_is_no_alarm():
    z = white(5, 100)
    z[50] = 40.0
    assert Detector(6, BLOCK).look(z) is None


def test_evidence_goes_from_stretch_to_stretch():
    z = white(11, 60)
    z[:, 1] += 3.0 / np.sqrt(10)
    at_once = Detector(6, BLOCK).look(z)
    detector = Detector(6, BLOCK)
    parts = [detector.copy().look(z[:4]), detector.look(z[:4]), detector.look(z[4:])]
    assert parts[:2] == [None, None]
    assert at_once is not None and parts[2] is not None
    assert parts[2].at + 4 == at_once.at
