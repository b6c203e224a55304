"""Ctrl-C, and other signals, while a record is written."""

import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from bench_records.layout import SignalInfo
from bench_records.record import read
from bench_records.recorder import Recorder

SIGNALS = [SignalInfo("left.height", "mm", 1e-3, "left"), SignalInfo("b"), SignalInfo("c")]
MS = 1_000_000


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="needs a thread that interrupts another")
def test_whoever_is_interrupted_in_the_middle_of_a_batch_leaves_a_record_that_is_right(
    tmp_path: Path,
) -> None:
    """In virtual time batches are written where the samples are made, which is where Ctrl-C arrives."""
    main, appending, over, interrupted = threading.get_ident(), threading.Event(), threading.Event(), 0

    def interrupt(_number: int, _frame: object) -> None:
        if appending.is_set():
            appending.clear()
            raise KeyboardInterrupt

    def interrupt_often() -> None:
        while not over.wait(3e-4):
            signal.pthread_kill(main, signal.SIGUSR2)

    recorder = Recorder(tmp_path, SIGNALS, start_ns=0, in_background=False)
    before = signal.signal(signal.SIGUSR2, interrupt)
    often = threading.Thread(target=interrupt_often)
    often.start()
    try:
        for batch in range(400):
            seconds = 2.0 * batch + np.linspace(0.0, 1.9, 2000)
            try:
                appending.set()
                recorder.receive(np.rint(1000 * MS * seconds), np.arange(2000) % 3, seconds)
                appending.clear()
            except KeyboardInterrupt:
                interrupted += 1
    finally:
        over.set()
        often.join()
        signal.signal(signal.SIGUSR2, before)
    recorder.close()
    assert interrupted > 20
    record = read(tmp_path)
    assert len(record) > 2000
    for info in SIGNALS:
        times, values = record.series(info.name)
        assert times == pytest.approx(values, abs=1e-8)
