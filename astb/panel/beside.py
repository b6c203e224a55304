"""What the twin of a run says while it goes on (`astb run --watch`), as the page shows it."""

from pathlib import Path
from typing import Any

from bench_records.layout import RecordError
from bench_records.twin import TWIN, read_twin


class Beside:
    """Reads what the twin of the present run has written, and reads it again when it has written more."""

    def __init__(self) -> None:
        self._read: tuple[Path, int] | None = None
        self._said: dict[str, Any] | None = None

    def said(self, record: str) -> dict[str, Any] | None:
        """Return what is said of the run in the directory ``record``; None where no twin has said anything."""
        path = Path(record) / TWIN
        try:
            now = path, path.stat().st_mtime_ns
        except OSError:
            return None
        if now != self._read:
            try:
                story = read_twin(path.parent)
            except RecordError:
                story = None
            self._read = now
            self._said = (
                None
                if story is None
                else {
                    "partings": [one.sentence for one in story.partings],
                    "judged": story.judged_for,
                    "until": story.until,
                    "why": story.judged[-1].why if story.judged else "",
                }
            )
        return self._said
