"""How the model's functions are compiled: ahead of use, cached, with the arithmetic of the plain-Python twin."""

import hashlib
from collections.abc import Callable, Iterable
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, Final

from bench_protocol.rates import TICK_RATE
from bench_protocol.realtime.binding import cached, protocol_sources


def digest_of(sources: Iterable[Traversable]) -> str:
    """Return what changes when one of the ``sources`` does, or the protocol or the model, which all others contain."""
    digest = hashlib.sha256()
    model = files("bench_sim.model")
    everything = [*protocol_sources(), *model.iterdir(), *model.joinpath("lanes").iterdir(), *sources]
    named = [source for source in everything if source.name.endswith(".py")]
    for source in sorted(named, key=lambda entry: (entry.name, entry.read_bytes())):
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    digest.update(str(TICK_RATE).encode())
    return digest.hexdigest()


class Compiler:
    """Compiles functions that are compiled anew when a source changes that stands in its ``digest``.

    With ``NUMBA_DISABLE_JIT=1`` functions stay plain Python: the same equations, the model's oracle.
    """

    def __init__(self, digest: str) -> None:
        self.digest = digest

    def compiled(self, function: Callable[..., Any]) -> Any:
        """Compile a term or a helper, and copy it into its callers; it must not make arrays."""
        # Without numba's runtime no array is counted: counting costs five times the arithmetic of a small term.
        return self._compile(function, _nrt=False, forceinline=True)

    def within(self, function: Callable[..., Any]) -> Any:
        """As `compiled`, for a helper around a right-hand side: compiled only as a part of each of its callers.

        On its own it would be compiled with everything that the right-hand side contains, and that once more.
        """
        return self._compile(function, _nrt=False, inline="always")

    def once(self, function: Callable[..., Any]) -> Any:
        """As `compiled`, for what is large and called from several places: compiled once and called.

        numba compiles it with what its first caller has: called by a `compiled` function, it is copied all the same.
        """
        return self._compile(function, _nrt=False)

    def entry(self, function: Callable[..., Any]) -> Any:
        """As `compiled`, for the few functions that make their own working arrays and call the others."""
        return self._compile(function)

    def parallel(self, function: Callable[..., Any]) -> Any:
        """As `entry`, for long calculations that several threads do at once: Python goes on meanwhile.

        The rig's tick is not one: to get Python back it would have to wait for whoever has it then.
        """
        return self._compile(function, nogil=True)

    def _compile(self, function: Callable[..., Any], **options: Any) -> Any:
        return cached(function, self.digest, fastmath=False, error_model="numpy", **options)


_MODEL: Final = Compiler(digest_of(()))
compiled, compiled_within, compiled_once = _MODEL.compiled, _MODEL.within, _MODEL.once
compiled_entry, compiled_parallel = _MODEL.entry, _MODEL.parallel
