"""The columns of a linearised model: sensitivities by finite differences, whitened, and shared between models."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.contracts import Array
from diagnosis.engine.columns import Columns
from diagnosis.engine.fitting.linear import Block, Linearisation, Prior, Raw, prior_of
from diagnosis.engine.fitting.point import Coordinate, Point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.threads import in_threads
from diagnosis.engine.whitening import Filter


def linearise(
    replay: Replay,
    whiten: Sequence[Filter],
    point: Point,
    predictions: Sequence[Array],
    prior: Prior,
    known: Linearisation | None = None,
    *,
    central: bool = False,
) -> Linearisation:
    """Linearise a model. Columns of a run's nuisances are taken from ``known`` if it has them.

    Columns that the same filter has whitened are not whitened again.
    """
    nuisances, effects = zip(*(_split_places(point, record) for record in replay.records), strict=True)
    shared = [
        _shared(known, run, [point.coordinates[i] for i in places])
        for run, places in zip(replay.names, nuisances, strict=True)
    ]
    missing = [
        [*(() if known_here else places), *more]
        for places, more, known_here in zip(nuisances, effects, shared, strict=True)
    ]
    quotients = replay.sensitivities(point, predictions, missing, central=central)
    residuals = replay.residuals(predictions)

    def block(r: int) -> Block:
        filter_ = whiten[r]
        count = quotients[r].size - len(effects[r])
        raw, white = shared[r] or (Raw(quotients[r].chosen(range(count)), filter_), None)
        if white is None or raw.passed is not filter_:
            raw = Raw(raw.columns, filter_)
            white = filter_.columns([raw.columns])
        own = filter_.columns([quotients[r].chosen(range(count, quotients[r].size))])
        parts = (nuisances[r], white), (effects[r], own)
        return Block(replay.names[r], filter_.packing, filter_(residuals[r]), parts, raw).multiplied()

    return Linearisation(point, prior, tuple(in_threads(replay.workers, block, range(len(whiten)))))


def from_quotients(
    replay: Replay,
    point: Point,
    whiten: Sequence[Filter],
    residuals: Sequence[Array],
    quotients: Sequence[Columns],
) -> Linearisation:
    """Linearise a model from given difference quotients by run, under the priors of its parameters."""

    def block(r: int) -> Block:
        run, filter_, columns = replay.runs[r], whiten[r], quotients[r]
        record = run.experiment.record
        order, (shared, own) = point.places_of(record), _split_places(point, record)
        raw = Raw(columns.chosen([order.index(i) for i in shared]), filter_)
        of_effects = columns.chosen([order.index(i) for i in own])
        parts = (shared, filter_.columns([raw.columns])), (own, filter_.columns([of_effects]))
        return Block(run.experiment.name, filter_.packing, filter_(residuals[r]), parts, raw).multiplied()

    return Linearisation(point, prior_of(point), tuple(in_threads(replay.workers, block, range(len(whiten)))))


def _split_places(point: Point, record: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the indices of the coordinates that the runs of a record depend on: of the nuisances, and of the
    effects.
    """
    places = point.places_of(record)
    owned = [bool(point.coordinates[i].owner) for i in places]
    return (
        tuple(i for i, effect in zip(places, owned, strict=True) if not effect),
        tuple(i for i, effect in zip(places, owned, strict=True) if effect),
    )


def _shared(
    known: Linearisation | None, run: str, nuisances: Sequence[Coordinate]
) -> tuple[Raw, Columns] | None:
    """Return the columns of a run's nuisances, raw and whitened, from ``known``; None if it does not have them."""
    for block in known.blocks if known else ():
        places, columns = block.parts[0]
        mine = known and block.run == run and [known.point.coordinates[i] for i in places] == nuisances
        if mine and block.raw is not None:
            return block.raw, columns
    return None
