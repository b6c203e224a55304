"""A run with its twin, the model that is compared with it: `astb watch` in its own process, for which no run waits.

There is one exception. In virtual time, a plan that reads the twin waits with a stopped clock, because the twin is
slower than the simulated rig.
"""

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from bench_protocol.clock import Clock, RealClock, VirtualClock
from bench_protocol.units import NS
from bench_records.layout import RecordError
from bench_records.twin import TWIN, Deviation, TwinStory, read_twin
from test_plans.run import NoTwin, TwinState

#: Time limit (s) of the twin for its last results after the end of a run, and for each result in a virtual run.
_PATIENCE: Final = 120.0
#: A twin without any processor time for this time (s) is stopped, or waits for an event that does not occur.
_STILL: Final = 10.0
#: After this time (s) a user who waits for the end of the run gets the reason.
_QUIET: Final = 3.0
#: A virtual run waits until the twin is at most this time (s) behind, and the interval (s) of its checks.
_BEHIND: Final = 2.0
_AGAIN: Final = 0.1
#: Largest delay (s) of the report of a deviation during a run, after the twin has stored it.
_NEWS: Final = 0.5


class _Pulse:
    """Detects whether a process works, by the growth of its processor time."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._stat, self._wall = Path(f"/proc/{process.pid}/stat"), RealClock()
        self._spent, self._since = "", 0

    @property
    def still(self) -> bool:
        """Whether the process has used no processor time for `_STILL` s.

        False if the system does not report this time.
        """
        with suppress(OSError):
            fields = self._stat.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            if (spent := " ".join(fields[11:13])) != self._spent:
                self._spent, self._since = spent, self._wall.now()
            return self._wall.now() - self._since > _STILL * NS
        return False


class RunTwin:
    """The twin of the run in ``directory``, in the form that the plan reads. ``clock`` is that of the bench."""

    def __init__(self, twin: "subprocess.Popen[str]", directory: Path, clock: Clock) -> None:
        self._twin, self._directory, self._clock = twin, directory, clock
        self._begun, self._virtual = clock.now(), isinstance(clock, VirtualClock)
        self._read: tuple[int, TwinStory | None] = (0, None)
        self._still = False

    @property
    def watching(self) -> bool:
        """Whether the twin still works."""
        return self._twin.poll() is None and not self._still

    @property
    def deviation(self) -> Deviation | None:
        """The present deviation of rig and model; None if they agree.

        In virtual time, this waits for the results of the twin.
        """
        story = self._caught_up() if self._virtual else self.story()
        return story.present_deviation if story is not None else None

    parted = deviation  # the old name, for one release

    def _caught_up(self) -> TwinStory | None:
        now, wall = (self._clock.now() - self._begun) / NS, RealClock()
        until, pulse = wall.now() + round(_PATIENCE * NS), _Pulse(self._twin)
        while (story := self.story()) is None or story.until < now - _BEHIND or _is_searched(story):
            self._still = self._still or pulse.still
            if not self.watching or wall.now() > until:
                break
            wall.sleep_until(wall.now() + round(_AGAIN * NS))
        return story

    def story(self) -> TwinStory | None:
        """The results that the twin has stored until now; None if there are none."""
        with suppress(OSError, RecordError):
            now = (self._directory / TWIN).stat().st_mtime_ns
            if now != self._read[0]:
                self._read = now, read_twin(self._directory)
        return self._read[1]


def _is_searched(story: TwinStory) -> bool:
    """Return whether the search for causes of the present deviation is still in progress."""
    return story.present_deviation is not None and not story.present_deviation.searched


@contextmanager
def watched(directory: Path, wanted: bool, clock: Clock, warn: Callable[[str], None]) -> Iterator[TwinState]:
    """Run a twin of the run that writes into ``directory`` during the block, and pass its findings to ``warn``.

    The twin ends by itself with the run. A failure of the twin does not affect the run.
    """
    if not wanted:
        yield NoTwin()
        return
    # In its own session: Ctrl-C ends the plan, and the twin detects this end.
    twin = subprocess.Popen(
        [sys.executable, "-m", "astb", "watch", str(directory)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    news = _News(RunTwin(twin, directory, clock), warn)
    try:
        yield RunTwin(twin, directory, clock)
    finally:
        news.end()
        _conclude(twin, directory, news, warn)


class _News:
    """Warns of each deviation as soon as the twin has stored it, and again when its kind changes."""

    def __init__(self, twin: RunTwin, warn: Callable[[str], None]) -> None:
        self._twin, self._warn = twin, warn
        self._reported: dict[float, tuple[str, str]] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="news of the twin", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop looking for news."""
        self._ended.set()
        self._thread.join()

    def report(self, story: TwinStory, *, final: bool) -> None:
        """Warn of each deviation that is new or has another kind; with ``final``, also of each changed sentence."""
        for one in story.all_deviations:
            word = one.course[-1].word if one.course else ""
            before = self._reported.get(one.detected)
            if one.sentence and (
                before is None or before[0] != word or (final and before[1] != one.sentence)
            ):
                self._reported[one.detected] = (word, one.sentence)
                self._warn(one.sentence)

    def _follow(self) -> None:
        while not self._ended.wait(_NEWS):
            if (story := self._twin.story()) is not None:
                self.report(story, final=False)


def _conclude(
    twin: "subprocess.Popen[str]", directory: Path, news: _News, warn: Callable[[str], None]
) -> None:
    wall, pulse, reported, output = RealClock(), _Pulse(twin), False, ""
    while True:
        try:
            _, output = twin.communicate(timeout=_AGAIN)
            break
        except subprocess.TimeoutExpired:
            late = wall.now() > _PATIENCE * NS
            if late or pulse.still:
                twin.kill()
                twin.communicate()
                why = f"did not end within {_PATIENCE:g} s" if late else f"made no progress for {_STILL:g} s"
                warn(
                    f"the comparison with the model (process {twin.pid}) {why} and was ended; "
                    f"repeat it with `astb watch {directory}`"
                )
                return
            if not reported and wall.now() > _QUIET * NS:
                reported = True
                warn(f"waiting at most {_PATIENCE:g} s for the last results of the comparison with the model")
    with suppress(RecordError):
        story = read_twin(directory)
        if story is not None:
            news.report(story, final=True)
            return
    text = output.strip().splitlines()[-1] if output.strip() else "without an error message"
    warn(f"the comparison with the model failed: {text}; repeat it with `astb watch {directory}`")
