"""How often a diagnosis is right, measured on systems with something hidden in them."""

from bench_protocol.runtime.own_process import keep_algebra_to_one_core

keep_algebra_to_one_core()
