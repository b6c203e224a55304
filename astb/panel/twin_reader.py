"""What the twin of a run says while it goes on (`astb run --watch`), as the page shows it."""

from pathlib import Path
from typing import Any

from bench_records.layout import RecordError
from bench_records.twin import TWIN, read_twin


class TwinReader:
    """Reads what the twin of the present run has written, and reads it again when it has written more."""

    def __init__(self) -> None:
        self._read: tuple[Path, int] | None = None
        self._story: dict[str, Any] | None = None

    def story(self, record: str) -> dict[str, Any] | None:
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
            self._story = (
                None
                if story is None
                else {
                    "partings": [one.sentence for one in story.all_deviations],
                    "judged": story.judged_for,
                    "until": story.until,
                    "why": story.judged[-1].why if story.judged else "",
                }
            )
        return self._story
