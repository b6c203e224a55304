"""The black box data of an incident, which are stored with the record of the run as a text and samples."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bench_records.disk import kept
from bench_records.layout import put
from bench_records.record import Record

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]

STORY = "black_box.txt"
SAMPLES = "black_box.parquet"
_TIME = "time_s"
#: The signals that are drawn if the story of an incident does not begin with a signal.
_ELSE = ("left.bellows_pressure", "right.bellows_pressure")


def write_incident(
    directory: Path | str, story: str, times: Numbers, channels: Mapping[str, Numbers]
) -> None:
    """Write an incident to ``directory``. ``times`` are in s relative to the incident. ``channels`` are in SI by
    signal name, with NaN for no reading.

    Raises NotKept for a disk error.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    with kept(Path(directory) / SAMPLES):
        samples = pa.BufferOutputStream()
        pq.write_table(pa.table({_TIME: times, **channels}), samples)
        put(Path(directory) / SAMPLES, samples.getvalue().to_pybytes())
        put(
            Path(directory) / STORY, story.encode()
        )  # written last, so that the samples exist if the story exists


class IncidentSection(NamedTuple):
    """The text and the drawing of an incident in a report."""

    story: str
    drawing: str


def incident_of(record: Record) -> IncidentSection | None:
    """Return the black box text of a run, with a drawing of the tripped signal. Return None if there was
    no incident.
    """
    import pyarrow.parquet as pq

    from bench_records.layout import as_array
    from bench_records.report_plots import Series, time_panel

    directory = record.path.parent
    if not (directory / STORY).exists():
        return None
    story = (directory / STORY).read_text(encoding="utf-8")
    table = pq.read_table(directory / SAMPLES)
    cause = story.split(" ", 1)[-1]
    known = [name for name in table.column_names if name in record.signals and record.signals[name].quantity]
    named = [name for name in known if cause.startswith(name.replace(".", " ").replace("_", " "))]
    names = [name for name in named or _ELSE if name in known]
    if not names:
        return IncidentSection(story, "")
    signal, times = record.signals[names[0]], as_array(table[_TIME])
    lines = [
        Series(record.signals[name].title, times, as_array(table[name]) / signal.scale) for name in names
    ]
    span = (float(times[0]), float(times[-1]))
    title = f"{signal.quantity} around the incident"
    return IncidentSection(story, time_panel("black-box", title, signal.unit, lines, [], span, [0.0]))
