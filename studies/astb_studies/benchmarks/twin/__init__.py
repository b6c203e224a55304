"""How often a twin is wrong, how soon it tells what begins, and which causes it names (`python -m benchmarks.twin`)."""

from bench_protocol.system.one_core import keep_algebra_to_one_core

keep_algebra_to_one_core()
