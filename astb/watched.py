"""A run with its twin: `astb watch` in a process of its own beside it, so that nothing of the run waits for it.

Only a plan that asks in virtual time waits, while its clock stands: no twin would be as fast as the rig is there.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from bench_protocol.clock import Clock, RealClock, VirtualClock
from bench_protocol.units import NS
from bench_records.layout import RecordError
from bench_records.twin import TWIN, Parting, TwinStory, read_twin
from test_plans.beside import Alone, Beside

#: So long (s) the twin may take for its last look after the run has ended, and to come after a virtual run.
_PATIENCE: Final = 120.0
#: A virtual run waits until the twin has seen all but the last s, and looks every so many s whether it has.
_BEHIND: Final = 2.0
_AGAIN: Final = 0.1


class TwinBeside:
    """The twin of the run that writes into ``directory``, as its plan sees it; ``clock`` is that of its bench."""

    def __init__(self, twin: "subprocess.Popen[str]", directory: Path, clock: Clock) -> None:
        self._twin, self._directory, self._clock = twin, directory, clock
        self._begun, self._virtual = clock.now(), isinstance(clock, VirtualClock)
        self._read: tuple[int, TwinStory | None] = (0, None)

    @property
    def watching(self) -> bool:
        """Whether the twin still lives."""
        return self._twin.poll() is None

    @property
    def parted(self) -> Parting | None:
        """What it says last of rig and model that part."""
        story = self._caught_up() if self._virtual else self._story()
        return story.parted if story is not None else None

    def _caught_up(self) -> TwinStory | None:
        now, wall = (self._clock.now() - self._begun) / NS, RealClock()
        until = wall.now() + round(_PATIENCE * NS)
        while (story := self._story()) is None or story.until < now - _BEHIND or _is_searched(story):
            if not self.watching or wall.now() > until:
                break
            wall.sleep_until(wall.now() + round(_AGAIN * NS))
        return story

    def _story(self) -> TwinStory | None:
        with suppress(OSError, RecordError):
            now = (self._directory / TWIN).stat().st_mtime_ns
            if now != self._read[0]:
                self._read = now, read_twin(self._directory)
        return self._read[1]


def _is_searched(story: TwinStory) -> bool:
    """Whether causes are looked for of what parted last."""
    return story.parted is not None and not story.parted.searched


@contextmanager
def watched(directory: Path, wanted: bool, clock: Clock, warn: Callable[[str], None]) -> Iterator[Beside]:
    """Let a twin watch the run that writes into ``directory`` while the block lasts, and ``warn`` of what it found.

    It ends by itself with the run. Whatever becomes of it, the run goes on.
    """
    if not wanted:
        yield Alone()
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
        yield TwinBeside(twin, directory, clock)
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
