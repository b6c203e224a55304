"""The capture of the bus, as tshark reads it: a file, a named pipe, and live on TCP, each with everybody's frames."""

import os
import select
import shutil
import socket
import subprocess
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bench_protocol.frames import FRAME, Block, frame, join
from bench_protocol.units import NS
from bench_sim.rig.capture import Capture, CaptureFile, Tap
from bench_sim.rig.pcapng import header_bytes, packet_bytes
from drivers.hub_bus import HubBus
from tests.refusals import refuses

pytestmark = pytest.mark.skipif(
    not shutil.which("tshark"), reason="tshark is not installed (apt-get install tshark)"
)
FIELDS = (
    "frame.time_epoch",
    "can.id",
    "can.flags.xtd",
    "can.len",
    "data.data",
    "frame.packet_flags_direction",
)
OUTBOUND, INBOUND = 2, 1
Row = tuple[int, int, bool, bytes, int]


def tshark(*source: str) -> subprocess.Popen[str]:
    fields = [word for field in FIELDS for word in ("-e", field)]
    return subprocess.Popen(
        ["tshark", "-l", "-n", *source, "-T", "fields", *fields],
        stdout=subprocess.PIPE,
        text=True,
        stderr=subprocess.PIPE,
    )


def rows(text: str) -> list[Row]:
    """Return time (ns), identifier, extended, data and direction of every packet, as tshark decodes them."""
    found = []
    for line in text.splitlines():
        time_text, identifier, extended, length, data, direction = line.split("\t")
        seconds, _, fraction = time_text.partition(".")
        payload = bytes.fromhex(data)
        assert len(payload) == int(length)
        found.append(
            (int(seconds) * NS + int(fraction), int(identifier), extended == "1", payload, int(direction, 16))
        )
    return found


def read(path: Path) -> list[Row]:
    with tshark("-r", str(path)) as process:
        out, err = process.communicate(timeout=30)
    assert process.returncode == 0, err
    return rows(out)


def expected(block: Block, direction: int) -> list[Row]:
    return [
        (
            int(one["time"]),
            int(one["id"]),
            bool(one["extended"]),
            bytes(one["data"][: one["length"]]),
            direction,
        )
        for one in block
    ]


def random_frames(count: int, seed: int = 1) -> Block:
    chance = np.random.default_rng(seed)
    block = np.zeros(count, FRAME)
    block["time"] = 1_700_000_000 * NS + np.arange(count) * 123_457
    block["extended"] = chance.integers(0, 2, count)
    block["id"] = np.where(
        block["extended"], chance.integers(0, 1 << 29, count), chance.integers(0, 1 << 11, count)
    )
    block["length"] = chance.integers(0, 9, count)
    block["data"] = chance.integers(0, 256, (count, 8)) * (np.arange(8) < block["length"][:, None])
    return block


def test_every_frame_is_what_tshark_reads_to_the_nanosecond(tmp_path) -> None:
    block = random_frames(500)
    path = tmp_path / "bus.pcapng"
    path.write_bytes(
        header_bytes("vcan0")
        + packet_bytes(block[:300], outbound=True)
        + packet_bytes(block[300:], outbound=False)
    )
    assert read(path) == expected(block[:300], OUTBOUND) + expected(block[300:], INBOUND)


def test_a_reader_who_sleeps_loses_the_oldest_and_the_capture_says_how_many(tmp_path) -> None:
    tap, block = Tap("vcan0", waiting_max=100), random_frames(250)
    for k in range(0, 250, 10):
        tap.put(block[k : k + 10], outbound=True)
    path = tmp_path / "bus.pcapng"
    path.write_bytes(tap.end())
    assert read(path) == expected(block[150:], OUTBOUND)
    text = subprocess.run(["capinfos", "-M", str(path)], capture_output=True, text=True, check=True).stdout
    assert "Number of packets:   100" in text
    assert tap.dropped == 150


def test_a_directory_that_is_not_there_is_named(tmp_path) -> None:
    with refuses(OSError, "written"):
        CaptureFile(Capture(), tmp_path / "no" / "bus.pcapng", print)


@pytest.fixture
def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        return unused.getsockname()[1]


def received_for(bus: HubBus, seconds: float) -> Block:
    parts, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        parts.append(bus.recv_block(0.05))
    return join(parts)


@pytest.mark.slow
def test_file_and_live_port_show_the_rigs_frames_and_those_of_others(start_rig, tmp_path, free_port) -> None:
    path = tmp_path / "bus.pcapng"
    ports = ("--can", "tcp", "--can-port", "0", "--modbus-port", "0")
    rig = start_rig(*ports, "--capture", str(path), "--capture-port", str(free_port))
    with HubBus(port=rig.can_port) as bus, tshark("-i", f"TCP@127.0.0.1:{free_port}", "-c", "1500") as live:
        assert select.select([live.stdout], [], [], 20)[0], "tshark shows nothing"
        bus.recv_block(0)
        for k in range(5):
            bus.send_block(frame(0x7A0 + k, bytes(range(k))))
        received = received_for(bus, 0.5)
        shown = rows(live.communicate(timeout=20)[0])
    assert rig.stop() == ""
    kept = read(path)
    # A client hears everything but its own, and times to 1 µs.
    whole = [(t // 1000, *rest) for t, *rest in kept]
    for row in expected(received, OUTBOUND):
        assert (row[0] // 1000, *row[1:]) in whole
    others = [row for row in kept if row[4] == INBOUND]
    assert [(row[1], row[3]) for row in others] == [(0x7A0 + k, bytes(range(k))) for k in range(5)]
    assert len(shown) == 1500
    first = kept.index(shown[0])
    assert kept[first : first + 1500] == shown, "live and kept are the same, without a gap"
    assert [row for row in shown if row[4] == INBOUND] == others


@pytest.mark.slow
def test_a_named_pipe_serves_one_reader_after_the_other(tmp_path) -> None:
    pipe = tmp_path / "bus"
    os.mkfifo(pipe)
    capture, complaints = Capture(), []
    with closing(CaptureFile(capture, pipe, complaints.append)):
        for _ in range(2):
            with tshark("-i", str(pipe), "-c", "50") as reader:
                while reader.poll() is None:
                    capture.outgoing(frame(0x181, b"height"), 0)
                    time.sleep(0.005)
                shown = rows(reader.communicate(timeout=20)[0])
            assert [row[1:4] for row in shown] == [(0x181, False, b"height")] * 50
    assert complaints == []
