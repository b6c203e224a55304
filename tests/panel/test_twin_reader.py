"""What the twin of a run says, as the panel reads it while the run goes on."""

import os

from astb.panel.watch import TwinReader
from bench_records.twin import TWIN, Deviation, Judged, TwinStory, write_twin

SOUND = TwinStory(
    "astb", 80.0, (Judged(0.0, 40.0, None, "the air is being filled"), Judged(40.0, 80.0, True))
)
PARTED = TwinStory(
    "astb",
    90.0,
    (*SOUND.judged[:1], Judged(40.0, 90.0, False)),
    (Deviation(84.0, 80.0, "load_cell.1", 1.0, 2.0, 0.1, sentence="From 80 s on …"),),
)


def test_the_last_written_value_is_reported(tmp_path):
    twin = TwinReader()
    assert twin.story(str(tmp_path)) is None
    write_twin(tmp_path, SOUND)
    assert twin.story(str(tmp_path)) == {"partings": [], "judged": 40.0, "until": 80.0, "why": ""}
    write_twin(tmp_path, PARTED)
    os.utime(tmp_path / TWIN, ns=(1, 1))  # as if the clock of the disk were coarse
    assert twin.story(str(tmp_path))["partings"] == ["From 80 s on …"]
    assert twin.story(str(tmp_path / "another")) is None


def test_a_damaged_entry_is_ignored(tmp_path):
    (tmp_path / TWIN).write_text("{")
    assert TwinReader().story(str(tmp_path)) is None
