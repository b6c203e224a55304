"""Deterministic noise: a normally distributed number, computed by an integer hash from a seed, a counter and a
channel.

The hash works on 32 bits inside signed 64-bit integers, so compiled and plain Python give the same result.
"""

from math import cos, log, pi, sqrt

from bench_sim.model.compiled import compiled

_WORD = 0xFFFFFFFF


@compiled
def scramble(word: int) -> int:
    """Return a hash of a 32-bit integer (Wellons' lowbias32). Different integers have different hashes, and each
    input bit changes about half of the output bits.
    """
    word &= _WORD
    word = ((word ^ (word >> 16)) * 0x7FEB352D) & _WORD
    word = ((word ^ (word >> 15)) * 0x846CA68B) & _WORD
    return word ^ (word >> 16)


@compiled
def normal(seed: int, counter: int, channel: int) -> float:
    """Return a number from the normal distribution N(0, 1), by Box-Muller. The same three integers give the same
    number on every machine.
    """
    seed = int(seed)
    counter = int(counter)
    word = scramble(seed)
    word = scramble(word ^ ((seed >> 32) & _WORD))
    word = scramble(word ^ (counter & _WORD))
    word = scramble(word ^ ((counter >> 32) & _WORD))
    word = scramble(word + 2 * channel + 1)
    other = scramble(word + 0x9E3779B9)
    return sqrt(-2.0 * log((word + 0.5) / 4294967296.0)) * cos(2.0 * pi * other / 4294967296.0)
