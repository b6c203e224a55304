"""How often a diagnosis is right, measured on systems with something hidden in them."""

from bench_protocol.runtime.one_core import keep_algebra_to_one_core

keep_algebra_to_one_core()
