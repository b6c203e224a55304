"""A run with its twin: `astb watch` in a process of its own beside it, so that nothing of the run waits for it."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from bench_records.layout import RecordError
from bench_records.twin import read_twin

#: So long (s) the twin may take for its last look after the run has ended.
_PATIENCE: Final = 120.0


@contextmanager
def watched(directory: Path, wanted: bool, warn: Callable[[str], None]) -> Iterator[None]:
    """Let a twin watch the run that writes into ``directory`` while the block lasts, and ``warn`` of what it found.

    It ends by itself with the run. Whatever becomes of it, the run goes on.
    """
    if not wanted:
        yield
        return
    # In a session of its own: Ctrl-C ends the plan, and the twin sees the end of it.
    twin = subprocess.Popen(
        [sys.executable, "-m", "astb", "watch", str(directory)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield
    finally:
        _conclude(twin, directory, warn)


def _conclude(twin: "subprocess.Popen[str]", directory: Path, warn: Callable[[str], None]) -> None:
    try:
        _, said = twin.communicate(timeout=_PATIENCE)
    except subprocess.TimeoutExpired:
        twin.kill()
        twin.communicate()
        warn(f"the twin did not come to an end; `astb watch {directory}` does it later")
        return
    with suppress(RecordError):
        story = read_twin(directory)
        if story is not None:
            for parting in story.partings:
                warn(parting.sentence)
            return
    warn(f"the twin did not work: {said.strip().splitlines()[-1] if said.strip() else 'it said nothing'}")
