"""Reads a run again and again until it ends, compares it with its model, and stores the results."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from astb.diagnose import built_for
from bench_protocol.clock import RealClock, give_way, processor_time
from bench_protocol.units import NS
from bench_records.growing import GrowingRecord
from bench_records.layout import PARQUET, STREAM, RecordError
from bench_records.record import Record, read
from bench_records.stream import is_held
from bench_records.twin import TwinStory, write_twin
from bench_sim.parameters import ParameterError, load
from diagnosis.contracts import DiagnosisError
from diagnosis.twin.pace import Pace
from diagnosis.twin.twin import Twin

__all__ = ["DiagnosisError", "ParameterError", "RecordError", "watch"]

#: Longest time (s) until a run begins.
BEGINS: Final = 30.0


def watch(directory: Path, model: str, report: Callable[[TwinStory], None]) -> TwinStory:
    """Compare the run in ``directory`` with a ``model`` until the run ends. Store the results after each step, and pass
    them to ``report``; return the last results.

    Raises ParameterError for the model, RecordError if no run begins within `BEGINS` or if it cannot be read, and
    DiagnosisError if the model cannot be compared with the rig.
    """
    parameters = load(model)
    clock = RealClock()
    record = _opened(directory, clock)
    if isinstance(record, GrowingRecord):
        give_way()
    twin = Twin(record, built_for(parameters, [record]), model)
    pace = Pace(lambda: clock.now() / NS, processor_time)

    def keep(story: TwinStory) -> TwinStory:
        write_twin(directory, story)
        report(story)
        return story

    while True:
        pace.begin()
        continues = isinstance(record, GrowingRecord) and record.look()
        story = keep(twin.look(ended=not continues, later=True))
        if not continues:
            return story
        if isinstance(record, GrowingRecord):
            record.thin(twin.looks_back_to)
        if twin.searches:
            twin.search(pace.searching())
            if not twin.searches:
                keep(twin.story)
        clock.sleep_until(round(pace.next() * NS))


def _opened(directory: Path, clock: RealClock) -> Record:
    """Return the record of a run in progress, or of a finished one.

    Waits up to `BEGINS` s for a run that is about to begin.
    """
    until = clock.now() + round(BEGINS * NS)
    while clock.now() < until and not any((directory / name).exists() for name in (STREAM, PARQUET)):
        clock.sleep_until(clock.now() + round(0.1 * NS))
    return GrowingRecord(directory) if is_held(directory) else read(directory)
