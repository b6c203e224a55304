"""Reads the folder of a run. The run may have ended, may have been interrupted, or may still be running."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from bench_protocol.input_limits import RESULT_BYTES, read_bounded
from bench_records.layout import META, PARQUET, RESULT, STREAM, Condition, RecordedEvent, RecordError
from bench_records.record import Record, read
from bench_records.result import Check, Result, SpecimenFacts, conclude, read_result
from bench_records.stream import is_held, read_head

#: Files that identify the folder of a run, the best first.
SIGNS: Final = (RESULT, STREAM, PARQUET)
#: The entries of `meta.json` that do not describe the circumstances of a run.
_BESIDE: Final = {"samples", "duration_s", "events"}
_OF_THE_STREAM: Final = {"start_ns", "signals"}


class Unfinished(StrEnum):
    """The state of a run without a result."""

    INTERRUPTED = "interrupted"
    RUNNING = "running"


class RunFolder(NamedTuple):
    """A run: its result, the facts about its origin, and its verdict. Without a result file, the result is made from
    the record.
    """

    result: Result
    facts: dict[str, Any]
    verdict: str  #: an Outcome, or Unfinished


def open_run(directory: Path) -> RunFolder:
    """Return the run in a folder. Raises RecordError if the folder has no run, or one that cannot be read."""
    if (directory / RESULT).exists():
        result = read_result(directory)
        return RunFolder(result, facts_of(directory), result.verdict.value)
    if is_held(directory):
        facts = _head_facts(directory)
        return RunFolder(
            _unfinished(facts, "the run is still active", [], directory), facts, Unfinished.RUNNING
        )
    record = read(directory)
    facts = {name: value for name, value in record.meta.items() if name not in _BESIDE}
    return RunFolder(result_without(record), facts, Unfinished.INTERRUPTED)


def result_without(record: Record) -> Result:
    """Return a result for an interrupted run: its checks so far, and as the reason the phase in which it was
    interrupted.
    """
    inside = [phase.name for phase in record.phases if phase.end >= record.duration]
    where = f", in {' › '.join(inside)}" if inside else ""
    return _unfinished(
        record.meta,
        f"the run was cut off before its end, after {record.duration:.1f} s{where}",
        record.events,
        record.path.parent,
        phases=record.phases,
    )


def facts_of(directory: Path) -> dict[str, Any]:
    """Return the facts about the origin of a run from `meta.json`, or from the stream while there is one.

    The result is empty if neither can be read.
    """
    with suppress(OSError, ValueError, RecordError, RecursionError):
        if (directory / STREAM).exists():
            return _head_facts(directory)
        meta = msgspec.json.decode(read_bounded(directory / META, RESULT_BYTES), type=dict[str, Any])
        return {name: value for name, value in meta.items() if name not in _BESIDE}
    return {}


def _head_facts(directory: Path) -> dict[str, Any]:
    """Return the facts about the origin of a run from the head of its stream."""
    return {key: one for key, one in read_head(directory / STREAM).items() if key not in _OF_THE_STREAM}


def _unfinished(
    facts: dict[str, Any], reason: str, events: list[RecordedEvent], directory: Path, **rest: Any
) -> Result:
    name = str(facts.get("plan", directory.name))
    specimen = None
    with suppress(msgspec.ValidationError):
        specimen = msgspec.convert(facts.get("specimen"), SpecimenFacts | None)
    seed = facts.get("seed")
    return conclude(
        name,
        str(facts.get("title", name)),
        str(facts.get("instruction", "")),
        _details(events, "check", Check),
        reason=reason,
        rig=str(facts.get("rig", "")),
        seed=seed if isinstance(seed, int) else None,
        began=str(facts.get("date", "")),
        operator=str(facts.get("operator", "")),
        ambient=str(facts.get("ambient", "")),
        parameters={str(key): str(value) for key, value in dict(facts.get("set") or {}).items()},
        specimen=specimen,
        preconditions=_details(events, "precondition", Condition),
        **rest,
    )


def _details(events: list[RecordedEvent], kind: str, form: Any) -> list[Any]:
    """Return the data of all events of a ``kind``. Events of earlier versions without such data are left out."""
    found = []
    for event in events:
        if event.kind == kind:
            with suppress(msgspec.ValidationError):
                found.append(msgspec.convert(event.data.get("whole"), form))
    return found


def circumstances(meta: Mapping[str, Any]) -> list[str]:
    """Return texts on simulation and time of a run from its meta data. The list is empty for a real rig in real time.

    Keys of the meta data: ``simulated`` (bool), ``time`` ("virtual"), ``effects`` and ``change`` (name to text),
    ``faults`` (texts), ``sealed_effects`` (bool).
    """
    words = []
    if meta.get("simulated"):
        words.append("SIMULATED")
    if meta.get("time") == "virtual":
        words.append("VIRTUAL TIME")
    words += [f"effect {name} = {value}" for name, value in meta.get("effects", {}).items()]
    words += [f"changed {name} = {_as_text(value)}" for name, value in meta.get("change", {}).items()]
    words += [f"fault {one}" for one in meta.get("faults", [])]
    if meta.get("sealed_effects"):
        words.append("sealed effects (not shown)")
    return words


def flattened(facts: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values in nested tables, each with the path of its names, such as ``parameters › sha256``."""
    for key, value in facts.items():
        name = f"{above} \u203a {key}" if above else str(key)
        if isinstance(value, dict):
            yield from flattened(value, name)
        else:
            yield name, value


def _as_text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_as_text(one)}" for key, one in value.items())
    return ", ".join(map(_as_text, value)) if isinstance(value, list) else str(value)
