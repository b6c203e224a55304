"""The earliest possible detection: the same test, but with known cause, size and start time.

The cause gives the innovations z of a block the mean d, which the same filter in the same state computes. So
log L = d·z − |d|²/2, and its sum since the start of the cause is all the evidence in the data. The threshold is that of
the detector: the logarithm of the mean time between two false alarms, in blocks. The log L of a block is not limited.
"""

import numpy as np

from astb_studies.benchmarks.twin.cases import Case
from bench_records.record import Record
from bench_records.twin import Judged
from bench_sim.parameters import Parameters
from diagnosis.twin.detector import BETWEEN
from diagnosis.twin.innovations import BIN, BINS, BLOCK, judge, rough
from diagnosis.twin.replays import Replays
from diagnosis.twin.stretches import Stretch
from diagnosis.twin.twin import Seen, Twin


class WatchedWith(Twin):
    """A twin that also has the true effect: ``best`` is the earliest time at which it can be detected (s), or None."""

    def __init__(self, record: Record, parameters: Parameters, case: Case) -> None:
        super().__init__(record, parameters, "astb")
        self.best: float | None = None
        self._case, self._sum = case, 0.0

    def _judge(self, stretch: Stretch) -> Judged:
        case = self._case
        known = any(one.detected >= case.at for one in self._deviations) and not (case.gone or case.second)
        # The search for causes takes longer than the run.
        if case.effect and (known or stretch.start > case.until):
            return Judged(stretch.start, stretch.end, None, "it is known by now, or too late")
        return super()._judge(stretch)

    def _see(self, stretch: Stretch, end: float, before: Seen | None = None) -> Seen:
        seen = super()._see(stretch, end, before)
        case = self._case
        alone = case.effect and not (case.creeps or case.gone or case.second)
        if alone and self.best is None and end > case.at:
            self._weigh(seen)
        return seen

    def _weigh(self, seen: Seen) -> None:
        case, start, columns, estimate = self._case, seen.start, seen.columns, seen.estimate
        onset = max(round((case.at - start) / BIN), 0)
        cause = self._simulator.catalogue[case.effect]
        shapes = {shape.name: shape.nominal for shape in cause.shapes}
        (column,) = Replays(seen.run, self._simulator).columns([(cause, shapes, case.size)], onset)
        if column is None:
            return
        alone = columns._replace(measured=columns.simulated + case.size * column)
        off = rough(columns)
        d = np.nan_to_num(judge(alone, estimate._replace(mean=np.zeros_like(estimate.mean)), off).white)
        z = np.nan_to_num(judge(columns, estimate, off).white)
        ratios = (d * z - 0.5 * d**2).sum(axis=(1, 2))
        for b in range(onset // BINS, len(ratios)):
            self._sum += float(ratios[b])
            if self._sum >= np.log(BETWEEN / BLOCK):
                self.best = round(start + (b + 1) * BLOCK, 2)
                return
