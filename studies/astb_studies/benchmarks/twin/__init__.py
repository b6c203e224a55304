"""Counts the false alarms, delays and named causes of the twin."""

from bench_protocol.runtime.own_process import keep_algebra_to_one_core

keep_algebra_to_one_core()
