"""The CAN transport against peers that know cantools and nothing of ours, in memory and on python-can's own bus."""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from astb.acceptance.transports import Subject, check_transport
from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.frames import Block, frame, payload
from drivers.can_port import has_interface
from drivers.errors import LinkLost, WiringError
from drivers.memory import InMemoryCan
from drivers.wiring.can.transport import CanTransport
from drivers.wiring.transports import open_transport
from tests.drivers.can_stand import BUS, DATABASE, MS, FarEnd, InMemory, write_files


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_files(tmp_path_factory.mktemp("wiring"))


@pytest.fixture
def memory() -> InMemory:
    return InMemory()


@pytest.fixture
def connected(memory: InMemory, where: Path) -> Callable[..., CanTransport]:
    def connect(**changes: object) -> CanTransport:
        transport = CanTransport(
            "bus", {**BUS, **changes}, where, port=memory.port, functions=where / "own.py"
        )
        transport.lost = []
        transport.heard = []
        transport.subscribe(lambda time, points: transport.heard.append((time, dict(points))))
        transport.connect(memory.clock, transport.lost.append, within=1.0)
        return transport

    return connect


SUBJECT = {
    "readable": ("Heights.Left", "Air.Bellows", "Air.Chamber", "Air.Rate", "Echo.Target"),
    "written": {"Set.Target": "Echo.Target", "Set.Mode": "Echo.Mode"},
    "streamed": {"Stream.Value": "Echo.Stream"},
    "unavailable": "Heights.Right",
}


def test_it_conforms_in_memory_and_in_virtual_time(memory: InMemory, where: Path) -> None:
    def make() -> CanTransport:
        memory.silent = False
        return CanTransport("bus", BUS, where, port=memory.port)

    def silent_transport() -> CanTransport:
        memory.silent = True
        return CanTransport("bus", BUS, where, port=memory.port)

    def cut() -> None:
        memory.ports[-1].lose("the bus is cut here")

    findings = check_transport(Subject(make, nobody=silent_transport, cut=cut, clock=memory.clock, **SUBJECT))
    assert [str(finding) for finding in findings if finding.breach] == []
    assert ["`refused`" in finding.skipped for finding in findings if finding.skipped] == [True]
    assert memory.far.bad == []


@contextlib.contextmanager
def far_end(**bus: str) -> Iterator[FarEnd]:
    """A far end on one of python-can's own buses."""
    far, over = FarEnd(), threading.Event()

    def run() -> None:
        with can.Bus(**bus) as station:
            while not over.wait(0.01):
                while (message := station.recv(0)) is not None:
                    far.receive(
                        frame(message.arbitration_id, bytes(message.data), extended=message.is_extended_id)
                    )
                for record in far.frames():
                    station.send(
                        can.Message(
                            arbitration_id=int(record["id"]),
                            is_extended_id=bool(record["extended"]),
                            data=payload(record),
                        )
                    )

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield far
    finally:
        over.set()
        thread.join()


VIRTUAL = {"interface": "virtual", "channel": "transport of somebody"}  # knows no kernel and needs no rights


@pytest.mark.slow
@pytest.mark.real_time
def test_it_conforms_on_a_bus_of_python_cans(where: Path) -> None:
    def make(channel: str = VIRTUAL["channel"]) -> CanTransport:
        return open_transport("bus", {**BUS, "channel": channel}, where)

    with far_end(**VIRTUAL) as far:
        findings = check_transport(Subject(make, nobody=lambda: make("an empty one"), within=1.0, **SUBJECT))
    assert [str(finding) for finding in findings if finding.breach] == []
    skipped = [finding.skipped.split()[-1] for finding in findings if finding.skipped]
    assert skipped == ["`refused`", "`cut`"]
    assert far.bad == []


@pytest.mark.vcan
@pytest.mark.skipif(not has_interface("vcan0"), reason="tools/with_vcan.sh runs it where there is a vcan0")
@pytest.mark.real_time
def test_it_conforms_on_socketcan(where: Path) -> None:
    table = {**{key: said for key, said in BUS.items() if key not in VIRTUAL}, "bus": "vcan0"}
    subject = Subject(lambda: open_transport("bus", table, where), **SUBJECT)
    with far_end(interface="socketcan", channel="vcan0") as far:
        findings = check_transport(subject)
    assert [str(finding) for finding in findings if finding.breach] == []
    assert far.bad == []


@pytest.mark.real_time
def test_times_on_a_real_bus_are_those_of_the_bench(where: Path) -> None:
    clock, received = RealClock(), []
    transport = open_transport("bus", {**BUS, **VIRTUAL}, where)
    transport.subscribe(lambda time, points: received.append((time, clock.now())))
    with far_end(**VIRTUAL):
        transport.connect(clock, pytest.fail, within=1.0)
        time.sleep(0.2)
        transport.close()
    assert len(received) > 20
    assert all(0 <= now - stamp < 150 * MS for stamp, now in received)


def test_a_bus_that_cannot_be_opened(where: Path) -> None:
    for changes, words in (
        ({"interface": "no_such"}, "'to be chosen' of 'no_such' cannot be opened"),
        ({"interface": None, "bus": "can7"}, "not a CAN interface of this machine"),
    ):
        transport = CanTransport("bus", {**BUS, **changes}, where)
        with pytest.raises(LinkLost, match=words):
            transport.connect(RealClock(), pytest.fail, within=0.5)


# --- received frames ----------------------------------------------------------------------------------------------


def test_numbers_as_cantools_has_them(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    memory.wait(0.1)
    found = transport.read(["Heights.Left", "Heights.Right", "Air.Bellows", "Air.Chamber", "Air.Rate"])
    assert math.isnan(found.pop("Heights.Right"))
    assert found == pytest.approx(
        {"Heights.Left": 12.34, "Air.Bellows": 500.0, "Air.Chamber": 1000.0, "Air.Rate": -1.5}
    )
    memory.far.right_raw = -2047
    memory.wait(0.02)
    assert transport.read(["Heights.Right"])["Heights.Right"] == pytest.approx(-204.7)
    assert {"Air.Place", "Air.Bellows"} in [set(points) for _, points in transport.heard]
    assert transport.counts == {}


@pytest.mark.parametrize("begins", [{}, {"burst_begins": "Heights"}])
def test_a_burst_has_one_time(memory: InMemory, connected: Callable, begins: dict) -> None:
    """For any delay of a burst, or of the next one, if the first message of a burst is known."""
    transport = connected(burst="10 ms", **begins)
    memory.wait(0.03)
    transport.heard.clear()
    (port,), began = memory.ports, memory.clock.now() + 20 * MS
    sent = [[1, 2, 3], [11, 12, 13], [21, 26, 32], [33, 37, 40], [41, 42, 43], [51, 52, 53]]  # ms
    for times in sent:
        block = memory.far.frames()[[0, 1, 2]]
        block["time"] = [began + round(one * MS) for one in times]
        port.receive(block)
    found = [(received - began) / MS for received, _ in transport.heard]
    first = [1] * 3 + [11] * 3 + [21] * 2
    if begins:
        assert found == [*first, 32] + [33] * 3 + [41] * 3 + [51] * 3
    else:  # a late frame begins a burst, in which the next one is, from now on
        assert found == [*first] + [32] * 5 + [42] * 3 + [52] * 2


def test_what_is_stale_is_nan(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    assert transport.stale("Heights.Left") == 0.1, "three cycles of 10 ms are less"
    assert transport.stale("Air.Bellows") == 0.2, "each of two pages comes half as often"
    assert transport.stale("Echo.Mode") == 0.2
    memory.wait(0.1)
    memory.silent = True
    memory.wait(0.09)
    assert transport.read(["Heights.Left"])["Heights.Left"] == pytest.approx(12.34)
    memory.wait(0.03)
    assert math.isnan(transport.read(["Heights.Left"])["Heights.Left"])
    assert transport.alive() == pytest.approx(0.12, abs=0.02)


@pytest.mark.parametrize(
    ("mishap", "counted"),
    [
        (lambda block, k: block[1:] if k % 3 == 0 else block, {"lost": 10}),
        (lambda block, k: np.concatenate([block[:1], block]) if k % 3 == 0 else block, {"repeated": 10}),
    ],
)
def test_lost_and_repeated_frames_are_counted(
    memory: InMemory, connected: Callable, mishap: Callable, counted: dict
) -> None:
    transport = connected()
    count = iter(range(1, 1000))
    memory.change = lambda block: mishap(block, next(count))
    memory.wait(0.315)
    assert transport.counts == {"Heights": counted}
    times = [time for time, points in transport.heard if "Heights.Left" in points]
    assert len(times) == len(set(times)), "a repeated frame is no sample"


def test_a_counter_that_stands_still_is_no_news(memory: InMemory, connected: Callable) -> None:
    """A rig whose program hangs may go on sending its last frame."""
    transport = connected()
    last = memory.far.frames()
    memory.change = lambda block: last.copy()
    memory.wait(0.02)
    transport.heard.clear()
    memory.wait(1.0)
    assert not [points for _, points in transport.heard if "Heights.Left" in points]
    assert math.isnan(transport.read(["Heights.Left"])["Heights.Left"])
    memory.silent = True
    memory.wait(0.5)
    memory.silent = False
    memory.wait(0.02)  # after a silence the same count may be chance
    assert [points for _, points in transport.heard if "Heights.Left" in points]


def test_every_single_wrong_bit_is_found(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    bits = iter(range(1, 10_000))

    def flip(block: Block) -> Block:
        bit = next(bits) % 64
        block["data"][0, bit // 8] ^= 1 << bit % 8
        return block

    memory.change = flip
    memory.wait(0.01)
    before = len([1 for _, points in transport.heard if "Heights.Left" in points])
    memory.wait(0.64)
    assert len([1 for _, points in transport.heard if "Heights.Left" in points]) == before
    assert transport.counts["Heights"]["corrupt"] >= 64


def test_frames_too_short_and_pages_unknown(memory: InMemory, connected: Callable) -> None:
    transport = connected()

    def spoil(block: Block) -> Block:
        block["length"][0] = 7
        block["data"][1, 0] = 9  # a page that no signal has
        return block

    memory.change = spoil
    memory.wait(0.05)
    assert transport.counts == {"Heights": {"corrupt": 5}, "Air": {"unknown": 5}}
    assert transport.lost == []


KNOWN = [(message.frame_id, message.is_extended_frame) for message in DATABASE.messages]
OURS = {DATABASE.get_message_by_name(name).frame_id for name in ("Stream", "Heart")}


@pytest.mark.slow
@given(st.lists(st.tuples(st.sampled_from([*KNOWN, (0x123, False)]), st.binary(max_size=8)), max_size=40))
def test_received_bytes_become_numbers_or_are_counted(
    where: Path, frames: list[tuple[tuple[int, bool], bytes]]
) -> None:
    port, received = InMemoryCan(lambda block: None), []
    transport = CanTransport("bus", {**BUS, "answers": False}, where, port=lambda: port)
    transport.subscribe(lambda time, points: received.append(points))
    transport.connect(VirtualClock(), pytest.fail, within=1.0)
    for (identifier, extended), data in frames:
        port.receive(frame(identifier, data, extended=extended))
    assert all(type(value) is float for points in received for value in points.values())
    refused = sum(
        tally.get(what, 0)
        for tally in transport.counts.values()
        for what in ("corrupt", "repeated", "unknown")
    )
    theirs = [one for one, _ in frames if one in KNOWN and one[0] not in OURS]
    assert len(received) + refused == len(theirs)


# --- sent frames --------------------------------------------------------------------------------------------------


def test_written_once_with_counter_and_checksum(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    memory.far.received.clear()
    for k in range(40):
        transport.write({"Set.Target": k / 2, "Set.Mode": k})
    sent = [values for name, values in memory.far.received if name == "Set"]
    assert [values["Target"] for values in sent] == [k / 2 for k in range(40)]
    assert [values["Alive"] for values in sent] == [k % 15 for k in range(40)], "profile 1 counts to 14"
    assert memory.far.bad == []


def test_in_the_order_given_and_page_by_page(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    memory.far.received.clear()
    transport.write({"Pages.First": 11, "Set.Mode": 1, "Set.Target": 2, "Pages.Third": 3, "Pages.Second": 22})
    sent = [(name, {**values, "Crc": 0, "Alive": 0}) for name, values in memory.far.received]
    nothing = {"Crc": 0, "Alive": 0}
    assert sent == [
        ("Pages", {"Index": 1, "First": 11, **nothing}),
        ("Set", {"Mode": 1, "Target": 2, **nothing}),
        ("Pages", {"Index": 2, "Second": 22, "Third": 3, **nothing}),
    ]


def test_a_missing_number_is_not_invented(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    memory.far.received.clear()
    with pytest.raises(
        ValueError, match=r"Set cannot be sent: Mode has no value yet; .* values = \{ Mode = … \}"
    ):
        transport.write({"Set.Target": 1})
    memory.wait(0.2)
    assert transport.waiting == {"Stream": ["Value"]}
    assert {name for name, _ in memory.far.received} == {"Heart"}
    transport.stream({"Stream.Value": math.nan}, memory.clock.now())
    assert transport.waiting == {"Stream": ["Value"]}
    transport.stream({"Stream.Value": 3.5}, memory.clock.now())
    memory.wait(0.05)
    assert ("Stream", {"Value": 3.5, "Spare": 7, "Alive": 0}) in memory.far.received


def test_at_the_rigs_own_rate_while_somebody_streams(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    memory.wait(0.1)
    memory.far.received.clear()
    for k in range(100):
        transport.stream({"Stream.Value": k}, memory.clock.now())
        memory.wait(0.007)
    counted = [values for name, values in memory.far.received if name == "Stream"]
    assert len(counted) == 35, "0.7 s at 20 ms"
    assert [values["Alive"] for values in counted] == [k % 4 for k in range(35)]
    assert [name for name, _ in memory.far.received].count("Heart") == 14
    memory.wait(1.0)
    memory.far.received.clear()
    memory.wait(1.0)
    assert memory.far.received == [], "who streams no more does not look alive"
    transport.stream({}, memory.clock.now())
    memory.wait(0.1)
    assert len(memory.far.received) >= 5


def test_a_new_connection_streams_no_old_values(memory: InMemory, connected: Callable) -> None:
    transport = connected()
    transport.stream({"Stream.Value": 3.5}, memory.clock.now())
    memory.wait(0.05)
    transport.close()
    transport.connect(memory.clock, pytest.fail, within=1.0)
    assert transport.waiting == {"Stream": ["Value"]}
    memory.far.received.clear()
    memory.wait(0.3)
    assert memory.far.received == [], "no command on this one"
    assert transport.counts == {}, "what passed meanwhile is not lost"


def test_background_failures_are_reported(memory: InMemory, where: Path) -> None:
    """An exception of a user's checksum would end the stream without a message."""
    (where / "failing.py").write_text("def weighted(identifier, data):\n    return 1 // (data[1] - 3)\n")
    guard = {"signal": "Alive", "scheme": "function:weighted"}
    messages = {
        "Pages": {"every": "10 ms", "values": {"First": 0}},
        "Stream": {"checksum": {**guard}, "every": "10 ms"},
    }
    table = {**BUS, "messages": messages}
    transport = CanTransport("bus", table, where, port=memory.port, functions=where / "failing.py")
    lost: list[str] = []
    transport.connect(memory.clock, lost.append, within=1.0)
    transport.stream({"Stream.Value": 3 * 128, "Stream.Spare": 0}, memory.clock.now())
    memory.wait(0.1)
    assert lost == ["bus on to be chosen failed: ZeroDivisionError: integer division or modulo by zero"]
    with pytest.raises(LinkLost, match="ZeroDivisionError"):
        transport.stream({}, memory.clock.now())
    transport.close()


def test_pages_are_served_alternately(memory: InMemory, connected: Callable) -> None:
    transport = connected(messages={**BUS["messages"], "Pages": {"every": "10 ms"}})
    transport.stream({"Pages.First": 1}, memory.clock.now())
    memory.wait(0.1)
    assert {values["Index"] for name, values in memory.far.received if name == "Pages"} == {1}
    transport.stream({"Pages.Second": 2, "Pages.Third": 3}, memory.clock.now())
    memory.far.received.clear()
    memory.wait(0.1)
    indices = [values["Index"] for name, values in memory.far.received if name == "Pages"]
    assert indices in ([1, 2] * 5, [2, 1] * 5)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ({"Set.Target": 1000.5}, r"Set\.Target = 1000\.5 does not fit in the signal; use -1000 to 1000"),
        ({"Set.Mode": 256}, r"Set\.Mode = 256 does not fit in the signal; use 0 to 255"),
        ({"Set.Mode": math.nan}, r"Set\.Mode = nan does not fit"),
        ({"Set.Alive": 1}, r"Set.Alive is written by the transport"),
        ({"Set.Mod": 1}, r"Set has no signal 'Mod'; did you mean 'Mode'"),
        ({"Sets.Mode": 1}, r"no message for 'Sets\.Mode'; did you mean 'Set'"),
    ],
)
def test_what_cannot_be_written(memory: InMemory, connected: Callable, points: dict, words: str) -> None:
    transport = connected()
    before = len(memory.far.received)
    with pytest.raises(ValueError, match=words):
        transport.write({"Set.Target": 0, **points})
    assert len(memory.far.received) == before
    with pytest.raises(WiringError, match=r"messages\.Set needs its period"):
        transport.stream({"Set.Target": 1}, 0)


def test_only_our_own_messages_where_the_dbc_says_whose(memory: InMemory, connected: Callable) -> None:
    transport = connected(node="HOST")
    transport.require("Set.Mode", writable=True)
    with pytest.raises(WiringError, match=r"Echo\.Mode is sent by RIG, not by HOST"):
        transport.require("Echo.Mode", writable=True)


def test_a_bus_that_is_silent_and_a_rig_that_only_listens(memory: InMemory, where: Path) -> None:
    memory.silent = True
    transport = CanTransport("bus", BUS, where, port=memory.port)
    with pytest.raises(LinkLost, match=r"none of its 7 messages came in 0\.3 s; check that the rig runs"):
        transport.connect(memory.clock, pytest.fail, within=0.3)
    deaf = CanTransport("bus", {**BUS, "answers": False}, where, port=memory.port)
    deaf.connect(memory.clock, pytest.fail, within=0.3)
    deaf.write({"Set.Target": 1, "Set.Mode": 2})
    assert memory.far.received[-1][0] == "Set"
    deaf.close()
