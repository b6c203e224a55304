"""The columns of a linearised model: sensitivities by finite differences, whitened, shared where models share them."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.contracts import Array
from diagnosis.engine.columns import Columns
from diagnosis.engine.fitting.linear import Block, Linearisation, Prior, prior_of
from diagnosis.engine.fitting.point import Coordinate, Point
from diagnosis.engine.fitting.replay import Replay
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
    """Linearise a model; where ``known`` (whitened alike) has the columns of a run's nuisances, they are shared."""
    nuisances, effects = zip(*(_parted(point, record) for record in replay.records), strict=True)
    shared = [
        _shared(known, run, [point.coordinates[i] for i in places])
        for run, places in zip(replay.names, nuisances, strict=True)
    ]
    missing = [
        [*(places if columns is None else ()), *more]
        for places, more, columns in zip(nuisances, effects, shared, strict=True)
    ]
    quotients = replay.sensitivities(point, predictions, missing, central=central)
    residuals = replay.residuals(predictions)
    blocks = []
    for r, filter_ in enumerate(whiten):
        white, columns = filter_.columns([quotients[r]]), shared[r]
        count = white.size - len(effects[r])
        of_nuisances = white.chosen(range(count)) if columns is None else columns
        parts = (nuisances[r], of_nuisances), (effects[r], white.chosen(range(count, white.size)))
        blocks.append(Block(replay.names[r], filter_.packing, filter_(residuals[r]), parts))
    return Linearisation(point, prior, tuple(blocks))


def from_quotients(
    replay: Replay,
    point: Point,
    whiten: Sequence[Filter],
    residuals: Sequence[Array],
    quotients: Sequence[Columns],
) -> Linearisation:
    """Linearise a model whose quotients by run are there already, under the priors of its parameters."""
    blocks = []
    for run, filter_, residual, columns in zip(replay.runs, whiten, residuals, quotients, strict=True):
        record = run.experiment.record
        white, order = filter_.columns([columns]), point.places_of(record)
        shared, own = _parted(point, record)
        parts = (
            (shared, white.chosen([order.index(i) for i in shared])),
            (own, white.chosen([order.index(i) for i in own])),
        )
        blocks.append(Block(run.experiment.name, filter_.packing, filter_(residual), parts))
    return Linearisation(point, prior_of(point), tuple(blocks))


def _parted(point: Point, record: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the places of what a record's runs depend on: of the nuisances, and of the effects' own numbers."""
    places = point.places_of(record)
    owned = [bool(point.coordinates[i].owner) for i in places]
    return (
        tuple(i for i, effect in zip(places, owned, strict=True) if not effect),
        tuple(i for i, effect in zip(places, owned, strict=True) if effect),
    )


def _shared(known: Linearisation | None, run: str, nuisances: Sequence[Coordinate]) -> Columns | None:
    """Return the columns of a run's nuisances if they are known."""
    for block in known.blocks if known else ():
        places, columns = block.parts[0]
        if known and block.run == run and [known.point.coordinates[i] for i in places] == nuisances:
            return columns
    return None
