"""The columns of a linearised model: sensitivities by finite differences, whitened, shared where models share them."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.contracts import Array
from diagnosis.engine.fitting.linear import Block, Columns, Linearisation, Prior, prior_of
from diagnosis.engine.fitting.point import Coordinate, Point
from diagnosis.engine.fitting.replay import Quotients, Replay
from diagnosis.engine.noise import Filter


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
    places = [point.places_of(run) for run in replay.names]
    common = [[i for i in own if not point.coordinates[i].owner] for own in places]
    special = [[i for i in own if point.coordinates[i].owner] for own in places]
    shared = [
        _shared(known, run, [point.coordinates[i] for i in own])
        for run, own in zip(replay.names, common, strict=True)
    ]
    missing = [
        [*(own if held is None else ()), *more]
        for own, more, held in zip(common, special, shared, strict=True)
    ]
    quotients = replay.sensitivities(point, predictions, missing, central=central)
    residuals = replay.residuals(predictions)
    blocks = []
    for r, filter_ in enumerate(whiten):
        white, old = filter_(quotients[r]), shared[r]
        count = len(white) - len(special[r])
        nuisances = Columns(white[:count]) if old is None else old
        parts = (tuple(common[r]), nuisances), (tuple(special[r]), Columns(white[count:]))
        blocks.append(Block(replay.names[r], filter_(residuals[r]), parts))
    return Linearisation(point, prior, tuple(blocks))


def _shared(known: Linearisation | None, run: str, nuisances: Sequence[Coordinate]) -> Columns | None:
    """Return the columns of a run's nuisances if they are known."""
    for block in known.blocks if known else ():
        places, columns = block.parts[0]
        if known and block.run == run and [known.point.coordinates[i] for i in places] == nuisances:
            return columns
    return None


def from_quotients(
    names: Sequence[str],
    point: Point,
    whiten: Sequence[Filter],
    residuals: Sequence[Array],
    own: Sequence[Quotients],
) -> Linearisation:
    """Return the linearisation from quotients: the nuisances' columns, then those of the model's effects."""
    blocks = []
    for name, f, residual, quotients in zip(names, whiten, residuals, own, strict=True):
        white = f(quotients)
        parts = tuple(
            (
                tuple(i for i in point.places_of(name) if bool(point.coordinates[i].owner) is special),
                Columns(white[[bool(point.coordinates[i].owner) is special for i in point.places_of(name)]]),
            )
            for special in (False, True)
        )
        blocks.append(Block(name, f(residual), parts))
    return Linearisation(point, prior_of(point), tuple(blocks))
