"""Rates of right diagnoses, measured on systems with hidden effects."""

from bench_protocol.runtime.own_process import keep_algebra_to_one_core

keep_algebra_to_one_core()
