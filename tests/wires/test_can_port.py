"""One file of tests, three kinds of bus: python-can's in-process bus, the TCP hub, and the kernel's SocketCAN."""

import contextlib
import itertools
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest

from bench_protocol.frames import Block, empty_block, frame, join
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.servers import serve_in_thread
from drivers.can_port import PythonCanPort, can_interfaces, has_interface, open_can, resolve_can
from drivers.errors import LinkLost

OpenPort = Callable[[], PythonCanPort]
_names = itertools.count()

VCAN = [
    pytest.mark.vcan,
    pytest.mark.skipif(
        not has_interface("vcan0"),
        reason="this kernel has no vcan0; tools/with_vcan.sh runs it where there is one",
    ),
]


@pytest.fixture(scope="module")
def silent_vcan0() -> None:
    """Fail, with the sender's name, if another program uses vcan0: these tests count the received frames."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as listener:
        listener.bind(("vcan0",))
        listener.settimeout(0.1)  # a rig says something every 5 ms
        with contextlib.suppress(TimeoutError):
            word = int.from_bytes(listener.recv(16)[:4], sys.byteorder)
            pytest.fail(
                f"somebody sends {word:#x} on vcan0 (a rig?), and these tests need the bus for themselves"
            )


@pytest.fixture(params=["in process", "tcp", pytest.param("vcan0", marks=VCAN)])
def open_port(request: pytest.FixtureRequest) -> Iterator[OpenPort]:
    """Open any number of ports on one bus, all closed in the end."""
    if request.param == "vcan0":
        request.getfixturevalue("silent_vcan0")
    with contextlib.ExitStack() as stack:
        name = f"test {next(_names)}"
        if request.param == "tcp":
            tcp = stack.enter_context(serve_in_thread(CanHub(lambda block, peer: None))).can_port

        def make() -> PythonCanPort:
            if request.param == "in process":
                port = PythonCanPort(can.Bus(name, interface="virtual", ignore_config=True))
            elif request.param == "tcp":
                port = open_can("tcp", port=tcp)
            else:
                port = open_can("vcan0")
            stack.callback(port.close)
            return port

        yield make


class Listener:
    """A subscriber that keeps everything."""

    def __init__(self, port: PythonCanPort) -> None:
        self.blocks: list[Block] = []
        port.subscribe(self.blocks.append)

    def __len__(self) -> int:
        return sum(map(len, self.blocks))

    @property
    def block(self) -> Block:
        return join(self.blocks)


def test_frames_arrive_as_they_were_sent(open_port: OpenPort, eventually) -> None:
    a, b = open_port(), open_port()
    listener = Listener(b)
    frames = [
        frame(0x000, b""),
        frame(0x7FF, bytes(range(8))),
        frame(0x123, b"\xff"),
        frame(0x123, b"\x01\x02", extended=True),
        frame(0x1FFF_FFFF, bytes(8), extended=True),
    ]
    before = time.time_ns()
    a.send(join(frames))
    eventually(lambda: len(listener) == len(frames))
    got = listener.block
    # Some clocks of the kernel are coarser than the one this test reads.
    assert all(before - 20_000_000 <= stamp <= time.time_ns() for stamp in got["time"])
    got["time"] = 0
    assert got.tobytes() == join(frames).tobytes()


def test_a_burst_of_20_000_frames_while_the_program_computes(
    open_port: OpenPort, numbered, numbers, eventually
) -> None:
    a, b = open_port(), open_port()
    listener = Listener(b)
    count = 20_000
    sender = threading.Thread(target=lambda: [a.send(numbered(500, start)) for start in range(0, count, 500)])
    sender.start()
    total = 0
    while sender.is_alive():  # a plan that computes, in the same process
        total += sum(range(10_000))
    sender.join()
    eventually(lambda: len(listener) >= count, within=20, what=f"{count} frames ({len(listener)} so far)")
    assert numbers(listener.block) == list(range(count))
    assert b.overflows == 0


def test_a_client_receives_all_frames_except_its_own(open_port: OpenPort, eventually) -> None:
    ports = [open_port() for _ in range(3)]
    listeners = [Listener(port) for port in ports]
    for number, port in enumerate(ports):
        port.send(frame(number, b"me"))
        eventually(lambda number=number: sum(map(len, listeners)) == 2 * (number + 1))
    assert [sorted(listener.block["id"].tolist()) for listener in listeners] == [[1, 2], [0, 2], [0, 1]]


def test_an_empty_block_has_no_values(open_port: OpenPort, eventually) -> None:
    a, b = open_port(), open_port()
    listener = Listener(b)
    a.send(empty_block())
    a.send(frame(1, b""))
    eventually(lambda: len(listener))
    assert len(listener) == 1


def test_all_subscribers_receive_all_frames(open_port: OpenPort, numbered, numbers, eventually) -> None:
    a, b = open_port(), open_port()
    listeners = [Listener(b), Listener(b)]
    a.send(numbered(100))
    eventually(lambda: all(len(listener) == 100 for listener in listeners))
    assert all(numbers(listener.block) == list(range(100)) for listener in listeners)


def test_no_callback_after_close(open_port: OpenPort, numbered) -> None:
    a, b = open_port(), open_port()
    listener = Listener(b)
    reasons: list[str] = []
    b.on_lost(reasons.append)
    b.close()
    received = len(listener)
    a.send(numbered(10))
    time.sleep(0.05)
    assert len(listener) == received
    assert reasons == [], "who closes has not lost"
    with pytest.raises(LinkLost, match="was closed"):
        b.send(numbered(1))
    b.close()


def test_closing_is_quick_and_leaves_no_thread(open_port: OpenPort) -> None:
    before = threading.active_count()
    port = open_port()
    assert threading.active_count() == before + 1
    start = time.monotonic()
    port.close()
    assert time.monotonic() - start < 0.5
    assert threading.active_count() == before


def test_a_subscriber_that_fails_is_a_lost_port_not_a_silent_one(open_port: OpenPort, eventually) -> None:
    a, b = open_port(), open_port()

    def fail(block: Block) -> None:
        raise ZeroDivisionError("in the driver")

    b.subscribe(fail)
    reasons: list[str] = []
    b.on_lost(reasons.append)
    a.send(frame(1, b""))
    eventually(lambda: reasons)
    assert "a subscriber of" in reasons[0]
    assert "ZeroDivisionError: in the driver" in reasons[0]
    with pytest.raises(LinkLost, match="ZeroDivisionError"):
        b.send(frame(1, b""))
    late: list[str] = []
    b.on_lost(late.append)
    assert late == reasons, "a later subscriber is informed at once"


def test_remote_frames_do_not_come_through(
    open_port: OpenPort, request: pytest.FixtureRequest, eventually
) -> None:
    if "tcp" in request.node.name:
        pytest.skip("the socketcand protocol has no remote frames")
    a, b = open_port(), open_port()
    listener = Listener(b)
    a._bus.send(can.Message(arbitration_id=0x5, is_remote_frame=True, dlc=8, is_extended_id=False))
    a.send(frame(0x6, b"data"))
    eventually(lambda: len(listener))
    assert listener.block["id"].tolist() == [6]


# --- one kind only -------------------------------------------------------------------------------------------------


def test_a_hub_that_stops_is_lost(eventually) -> None:
    servers = serve_in_thread(CanHub(lambda block, peer: None))
    port = open_can("tcp", port=servers.can_port)
    reasons: list[str] = []
    port.on_lost(reasons.append)
    servers.stop()
    eventually(lambda: reasons, within=0.5)
    assert f"vcan0 at 127.0.0.1:{servers.can_port} is lost" in reasons[0]
    with pytest.raises(LinkLost):
        port.send(frame(1, b""))
    port.close()


def test_an_unopenable_bus_is_reported(dead_port: int) -> None:
    with pytest.raises(
        LinkLost, match=r"'tcp' cannot be opened: .*no server listens there; check that the rig runs"
    ):
        open_can("tcp", port=dead_port)
    with pytest.raises(LinkLost, match=r"not a CAN interface of this machine; use one of .*tcp"):
        open_can("can99")


def test_auto_is_vcan0_if_there_is_one() -> None:
    assert resolve_can("auto") == ("vcan0" if "vcan0" in can_interfaces() else "tcp")
    assert resolve_can("can0") == "can0"
    assert not has_interface("lo"), "an interface, but not of CAN"


@pytest.mark.vcan
@pytest.mark.skipif(not has_interface("vcan0"), reason="this kernel has no vcan0")
@pytest.mark.usefixtures("silent_vcan0")
def test_the_kernels_losses_are_counted(numbered, eventually) -> None:
    """A delayed receiver with a small buffer loses frames, and reports how many."""
    receiver, sender = open_can("vcan0"), open_can("vcan0")
    receiver._receiver._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    listener = Listener(receiver)
    hold = threading.Event()
    receiver.subscribe(lambda block: hold.wait(5))
    count = 2000
    sender.send(numbered(count))
    hold.set()
    time.sleep(0.2)
    # The count comes along with the next frame that finds room.
    eventually(lambda: not sender.send(frame(0x7FF, b"")) and receiver.overflows, within=5)
    receiver.close()
    sender.close()
    full = int((listener.block["length"] == 8).sum())
    assert full < count
    assert receiver.overflows >= count - full


@pytest.mark.vcan
@pytest.mark.skipif(not has_interface("vcan0"), reason="this kernel has no vcan0")
@pytest.mark.usefixtures("silent_vcan0")
def test_flags_in_the_identifier_are_masked_and_echoes_dropped(eventually) -> None:
    """A socket that receives its own frames stands for a bus that echoes."""
    bus = can.Bus("vcan0", interface="socketcan", receive_own_messages=True, ignore_config=True)
    port = PythonCanPort(bus)
    listener = Listener(port)
    port.send(frame(0x1, b"mine"))
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as other:
        other.bind(("vcan0",))
        for word in (0x4000_0001, 0x8000_0123, 0x0000_0124):  # remote, extended, standard
            other.send(struct.pack("=IB3x8s", word, 2, b"\x01\x02\xee\xee"))
        eventually(lambda: len(listener) >= 2)
    port.close()
    assert listener.block["id"].tolist() == [0x123, 0x124]
    assert listener.block["extended"].tolist() == [1, 0]
    assert listener.block["data"].tolist() == [[1, 2, *[0] * 6]] * 2
    assert np.all(listener.block["time"] > 0)
