"""Sensitivities of the outputs of one run, one column per parameter. The columns are packed: they hold only samples
that count, one channel after the other.

Theory of operation
-------------------
About half of all samples are missing or do not count, and most columns change few channels: the zero of a sensor
changes only its own channel, a leak on the left nothing on the right. So the samples that count are packed one channel
after the other (`Packing`), and each channel stores only the columns that change it (`Trace`). Inner products are sums
over channels. They are computed in double precision, even if the columns have single precision. The inner products of
each channel are cached while both columns exist, because many linearisations share columns, and white noise only
divides them by a number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import groupby, pairwise
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from diagnosis.contracts import Array, MeasuredRun
from diagnosis.engine.kernels import add_rows, block_products, quotients, weighted_sum
from diagnosis.engine.memory import first_rows, room

AnyFloats = NDArray[np.floating]
Mask = NDArray[np.bool_]
Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Packing:
    """The positions of the N samples ``counted`` (n, c) of a run after packing: channel after channel, sorted by time.

    ``places`` (N,) are their indices in the flattened outputs, ``instants`` (N,) their indices in time, ``bounds`` (c +
    1,) the borders of the channels in the packed array.
    """

    counted: Mask
    places: Places
    instants: NDArray[np.int32]
    bounds: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number N of samples that count."""
        return self.bounds[-1]

    def channel(self, c: int) -> slice:
        """Return the slice of one channel in the packed array."""
        return slice(self.bounds[c], self.bounds[c + 1])

    def pack(self, values: AnyFloats) -> AnyFloats:
        """Return the samples of ``values`` (n, c) that count, packed (N,)."""
        return values.ravel()[self.places]

    def spread(self, packed: Array) -> Array:
        """Return packed samples (N,) as an array (n, c); 0 where a sample does not count."""
        values = np.zeros(self.counted.size)
        values[self.places] = packed
        return values.reshape(self.counted.shape)

    def blocks(self, length: int) -> Places:
        """Return the borders (c, b + 1) of blocks of ``length`` time steps, as indices into the packed samples of each
        channel.
        """
        ends = np.minimum(np.arange(0, len(self.counted) + length, length), len(self.counted))
        before = np.concatenate(
            (np.zeros((1, self.counted.shape[1]), np.intp), np.cumsum(self.counted, axis=0))
        )
        return np.ascontiguousarray(before[ends].T)


def packing_of(run: MeasuredRun) -> Packing:
    """Return the packing of the samples of a run that count."""
    counted = run.counted
    return _packing(counted.shape, counted.tobytes())


@lru_cache(maxsize=16)  # every model uses the same few runs
def _packing(shape: tuple[int, int], mask: bytes) -> Packing:
    counted = np.frombuffer(mask, dtype=bool).reshape(shape)
    channel, sample = np.nonzero(counted.T)
    bounds = np.concatenate(([0], np.cumsum(counted.sum(axis=0))))
    return Packing(counted, sample * shape[1] + channel, sample.astype(np.int32), tuple(bounds.tolist()))


class Products:
    """The inner products of one array of samples with others. Each is cached while both arrays exist."""

    def __init__(self) -> None:
        self.known: WeakKeyDictionary[Products, Array] = WeakKeyDictionary()


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One channel of some columns: ``values`` (m, N) times ``scale``; ``rows`` (m,) are the columns that change it.

    Traces that differ only in scale share their ``products``.
    """

    rows: Places
    values: AnyFloats
    scale: float = 1.0
    products: Products = field(default_factory=Products)

    def scaled(self, factor: float) -> Trace:
        """Return the trace times ``factor``."""
        return replace(self, scale=factor * self.scale)

    def against(self, other: Trace) -> Array:
        """Return the inner products (m, k) with the k rows of another trace of this channel."""
        mine, theirs = self.products, other.products
        made = mine.known.get(theirs)
        if made is None and mine in theirs.known:
            made = theirs.known[mine].T
        if made is None:
            values = self.values.astype(np.float64, copy=False)
            made = values @ (values if theirs is mine else other.values.astype(np.float64, copy=False)).T
            mine.known[theirs] = made
        return self.scale * other.scale * made


class Columns:
    """Sensitivities of one run to ``size`` parameters, as the traces of its channels; immutable.

    `let_go` releases their memory. They cannot be used afterwards.
    """

    def __init__(self, size: int, traces: Sequence[Trace]) -> None:
        self.size = size
        self.traces = tuple(traces)

    @property
    def _slices(self) -> list[slice]:
        """The slice of each channel in the packed array."""
        ends = np.cumsum([trace.values.shape[1] for trace in self.traces]).tolist()
        return [slice(start, stop) for start, stop in pairwise((0, *ends))]

    @cached_property
    def gram(self) -> Array:
        """Inner products (k, k) of the columns with each other."""
        gram = np.zeros((self.size, self.size))
        for trace in self.traces:
            if len(trace.rows):
                gram[np.ix_(trace.rows, trace.rows)] += trace.against(trace)
        return gram

    def against(self, other: Columns) -> Array:
        """Return the inner products (k, m) with m further columns."""
        if isinstance(other, JoinedColumns):
            return np.hstack([self.against(part) for part in other.parts])
        made = np.zeros((self.size, other.size))
        for mine, theirs in zip(self.traces, other.traces, strict=True):
            if len(mine.rows) and len(theirs.rows):
                made[np.ix_(mine.rows, theirs.rows)] += mine.against(theirs)
        return made

    def times(self, packed: Array) -> Array:
        """Return the inner products (k,) with packed samples (N,)."""
        return self.by_block(packed, np.array([(0, trace.values.shape[1]) for trace in self.traces]))[:, 0]

    def by_block(self, packed: Array, blocks: Places) -> Array:
        """Return the inner products (k, b) with packed samples (N,) in each block. ``blocks`` (c, b + 1) are from
        `Packing.blocks`.
        """
        made = np.zeros((self.size, blocks.shape[1] - 1))
        for trace, inside, edges in zip(self.traces, self._slices, blocks, strict=True):
            products = np.empty((len(trace.rows), made.shape[1]))
            block_products(trace.values, packed[inside], edges, products)
            made[trace.rows] += trace.scale * products
        return made

    def along(self, numbers: Array) -> Array:
        """Return the sum (N,) of all columns, each multiplied by its number."""
        made = np.empty(sum(trace.values.shape[1] for trace in self.traces))
        for trace, inside in zip(self.traces, self._slices, strict=True):
            weighted_sum(trace.scale * numbers[trace.rows], trace.values, made[inside])
        return made

    def plus(self, packed: Array, numbers: Array) -> Columns:
        """Return new columns: each column plus its number times the packed samples (N,)."""
        traces = []
        for trace, inside in zip(self.traces, self._slices, strict=True):
            values = np.outer(numbers, packed[inside])
            values[trace.rows] += trace.scale * trace.values
            traces.append(Trace(np.arange(self.size), values))
        return Columns(self.size, traces)

    def chosen(self, places: Sequence[int]) -> Columns:
        """Return the columns at ``places``, in this order. Adjacent columns are views of the data, not copies."""
        if list(places) == list(range(self.size)):
            return self
        order = np.full(self.size, -1)
        order[list(places)] = np.arange(len(places))
        traces = []
        for trace in self.traces:
            inside = _stretch(np.flatnonzero(order[trace.rows] >= 0))
            traces.append(Trace(order[trace.rows[inside]], trace.values[inside], trace.scale))
        return Columns(len(places), traces)

    def let_go(self) -> None:
        """Release the memory, even if other objects hold these columns. They must not be used again."""
        del self.traces

    def among(self, places: Sequence[int], size: int) -> Columns:
        """Return ``size`` columns: these columns at ``places``, and zeros elsewhere."""
        order = np.asarray(places, np.intp)
        return Columns(size, [replace(trace, rows=order[trace.rows]) for trace in self.traces])


def _stretch(places: Places) -> Places | slice:
    """Return increasing ``places`` as a slice if they are adjacent, so that indexing makes a view; otherwise
    unchanged.
    """
    if len(places) and places[-1] - places[0] == len(places) - 1:
        return slice(int(places[0]), int(places[-1]) + 1)
    return places


class JoinedColumns(Columns):
    """Columns of several ``parts``, one after the other, without copies."""

    def __init__(self, parts: Sequence[Columns]) -> None:
        super().__init__(sum(part.size for part in parts), ())
        self.parts = tuple(parts)

    @cached_property
    def gram(self) -> Array:
        """Inner products (k, k) of the columns with each other."""
        return np.block(
            [[one.gram if one is other else one.against(other) for other in self.parts] for one in self.parts]
        )

    def against(self, other: Columns) -> Array:
        """Return the inner products (k, m) with m further columns."""
        return np.vstack([part.against(other) for part in self.parts])

    def by_block(self, packed: Array, blocks: Places) -> Array:
        """Return the inner products (k, b) with packed samples (N,) in each block. ``blocks`` (c, b + 1) are from
        `Packing.blocks`.
        """
        return np.vstack([part.by_block(packed, blocks) for part in self.parts])

    def times(self, packed: Array) -> Array:
        """Return the inner products (k,) with packed samples (N,)."""
        return np.concatenate([part.times(packed) for part in self.parts])

    def along(self, numbers: Array) -> Array:
        """Return the sum (N,) of all columns, each multiplied by its number."""
        split = np.split(numbers, self._ends[:-1])
        return np.asarray(sum(part.along(own) for part, own in zip(self.parts, split, strict=True)))

    def plus(self, packed: Array, numbers: Array) -> Columns:
        """Return new columns: each column plus its number times the packed samples (N,)."""
        split = np.split(numbers, self._ends[:-1])
        return JoinedColumns([part.plus(packed, own) for part, own in zip(self.parts, split, strict=True)])

    def chosen(self, places: Sequence[int]) -> Columns:
        """Return the columns at ``places``, in this order."""
        found = []
        for k, inside in groupby(places, key=lambda place: int(np.searchsorted(self._ends, place, "right"))):
            start = int(self._ends[k]) - self.parts[k].size
            found.append(self.parts[k].chosen([place - start for place in inside]))
        return found[0] if len(found) == 1 else JoinedColumns(found)

    @property
    def _ends(self) -> Places:
        """The end index of each part among all columns."""
        return np.cumsum([part.size for part in self.parts])


class ColumnsInWork:
    """Columns of one run that are filled one by one, in any order and by several threads."""

    def __init__(self, packing: Packing, size: int) -> None:
        self._packing, self._size = packing, size
        self._values = [room((size, stop - start)) for start, stop in pairwise(packing.bounds)]
        self._moved = np.zeros((size, len(self._values)), bool)

    def put(self, place: int, outputs: Array, predictions: Array, distance: float = 1.0) -> None:
        """Store the column at ``place``: (outputs − predictions) / distance, both (n, c), in single precision."""
        packed, moved = np.empty(self._packing.size, np.float32), self._moved[place]
        bounds = np.array(self._packing.bounds)
        # A simulator that leaves each channel in one piece spares this a copy.
        after, before = np.ascontiguousarray(outputs.T), np.ascontiguousarray(predictions.T)
        quotients(after, before, distance, self._packing.instants, bounds, packed, moved)
        for c in np.flatnonzero(moved).tolist():
            self._values[c][place] = packed[self._packing.channel(c)]

    def done(self) -> Columns:
        """Return the columns and release the memory. All columns must have been put."""
        traces = []
        for c, rows in enumerate(map(np.flatnonzero, self._moved.T)):
            values, self._values[c] = self._values[c], room((0, 0))
            for to, row in enumerate(rows.tolist()):
                if to < row:
                    values[to] = values[row]
            traces.append(Trace(rows, first_rows(values, len(rows))))
        return Columns(self._size, traces)


def columns_of(packing: Packing, values: AnyFloats) -> Columns:
    """Return columns (k, n, c) in packed form."""
    work = ColumnsInWork(packing, len(values))
    for k, row in enumerate(values):
        work.put(k, row, np.zeros_like(row))
    return work.done()


def mixed(parts: Sequence[Columns], weights: Array) -> Columns:
    """Return the weighted sum of ``parts``, which are sets of the same k columns; each column has its own ``weights``
    (p, k).
    """
    channels = zip(*(part.traces for part in parts), strict=True)
    return Columns(parts[0].size, [_mixed(channel, weights, room) for channel in channels])


def _mixed(parts: Sequence[Trace], weights: Array, zeros: Callable[..., AnyFloats]) -> Trace:
    """Return one channel of the sum of `mixed`, in an array allocated by ``zeros``."""
    moved = [np.flatnonzero(weight[trace.rows] != 0.0) for trace, weight in zip(parts, weights, strict=True)]
    places = [trace.rows[mine] for trace, mine in zip(parts, moved, strict=True)]
    rows = np.unique(np.concatenate(places))
    first = parts[0].values
    values = zeros((len(rows), first.shape[1]), first.dtype)
    for trace, mine, own, weight in zip(parts, moved, places, weights, strict=True):
        factors = (trace.scale * weight[own]).astype(values.dtype)
        add_rows(trace.values, mine, factors, np.searchsorted(rows, own), values)
    return Trace(rows, values)


def apart(first: Columns, second: Columns, scales: Array) -> Array:
    """Return the sums of squares (k,) of the difference between two sets of k columns, with channels scaled by
    ``scales`` (c,).
    """
    signs = np.outer((1.0, -1.0), np.ones(first.size))
    # One channel after the other, in the same memory: else new pages would be allocated for each.
    pairs = zip(first.traces, second.traces, strict=True)
    return _squares(first.size, (_mixed(pair, signs, np.zeros) for pair in pairs), scales)


def squares(columns: Columns, scales: Array) -> Array:
    """Return the sums of squares (k,) of k columns, channels scaled by ``scales`` (c,)."""
    return _squares(columns.size, columns.traces, scales)


def _squares(size: int, traces: Iterable[Trace], scales: Array) -> Array:
    found = np.zeros(size)
    for trace, scale in zip(traces, scales, strict=True):
        own = np.einsum("ij,ij->i", trace.values, trace.values, dtype=np.float64)
        found[trace.rows] += (trace.scale / scale) ** 2 * own
    return found
