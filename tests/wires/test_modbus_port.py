"""The contract of the one module that knows pymodbus, on a socket and in memory: the same answers, the same bytes."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from bench_protocol.modbus import answer
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.servers import serve_in_thread
from drivers.errors import LinkLost, Refused
from drivers.modbus_port import InMemoryModbus, ModbusPort, open_modbus
from tests.refusals import refuses


@pytest.fixture(params=["tcp", "in memory"])
def port(request: pytest.FixtureRequest, bank) -> Iterator[ModbusPort]:
    with contextlib.ExitStack() as stack:
        if request.param == "tcp":
            server = ModbusTcpServer(lambda adu, peer: answer(adu, bank))
            servers = stack.enter_context(serve_in_thread(modbus_server=server))
            device = open_modbus("127.0.0.1", servers.modbus_port)
        else:
            device = InMemoryModbus(lambda adu: answer(adu, bank))
        stack.callback(device.close)
        yield device


def test_reading(port: ModbusPort, bank) -> None:
    bank.coils[10:13] = [True, False, True]
    bank.holding[5] = 0xFFFF
    assert port.read_coils(10, 3) == [True, False, True]
    assert port.read_discrete(0, 4) == [True, False, False, True]
    assert port.read_holding(4, 3) == [0, 0xFFFF, 0]
    assert port.read_input(0, 125) == bank.input[:125]


def test_fewer_bits_than_were_asked_for_are_no_answer() -> None:
    port = InMemoryModbus(lambda adu: adu[:4] + b"\0\4" + adu[6:8] + b"\1\xff")
    with refuses(LinkLost, "sent 8 12"):
        port.read_coils(0, 12)


def test_writing(port: ModbusPort, bank) -> None:
    port.write_coil(7, True)
    port.write_coils(20, [True] * 9 + [False])
    port.write_registers(100, [1, 2, 65535])
    assert bank.coils[7]
    assert bank.coils[20:30] == [True] * 9 + [False]
    assert bank.holding[100:103] == [1, 2, 65535]
    port.write_coil(7, False)
    assert not bank.coils[7]


def test_identification(port: ModbusPort, bank) -> None:
    assert port.identification() == bank.objects
    bank.objects = {number: bytes([number]) * 100 for number in (0, 1, 2, 0x80, 0x81)}
    assert port.identification() == bank.objects


@pytest.mark.parametrize(
    ("call", "code", "words"),
    [
        (lambda port: port.read_input(999, 2), 2, "registers 999 1000"),
        (lambda port: port.write_coil(1000, True), 2, "coil 1000"),
        (lambda port: port.write_registers(999, [1, 2]), 2, "registers 999 1000"),
    ],
)
def test_a_refusal_in_words(
    port: ModbusPort, call: Callable[[ModbusPort], object], code: int, words: str
) -> None:
    with refuses(Refused, words) as caught:
        call(port)
    assert caught.value.code == code
    assert port.read_input(0, 1) == [1], "a refusal does not disturb the next request"


def test_a_device_failure_in_words(port: ModbusPort, bank) -> None:
    bank.broken = True
    with refuses(Refused, "device") as caught:
        port.read_holding(0, 1)
    assert caught.value.code == 4


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda port: port.read_input(0, 126), "count 126"),
        (lambda port: port.read_input(0, 0), "count 0"),
        (lambda port: port.read_coils(0, 2001), "count 2001"),
        (lambda port: port.write_registers(0, [0] * 124), "count 124"),
        (lambda port: port.write_registers(0, []), "count 0"),
        (lambda port: port.write_registers(0, [70000]), "70000 does"),
        (lambda port: port.write_registers(0, [-1]), "-1 does"),
        (lambda port: port.read_input(65535, 2), "address 65535 count 2"),
        (lambda port: port.read_input(-1, 1), "address -1"),
    ],
)
def test_what_no_request_can_carry(
    port: ModbusPort, call: Callable[[ModbusPort], object], words: str
) -> None:
    with refuses(ValueError, words):
        call(port)


def test_threads_may_share_a_port(port: ModbusPort, bank) -> None:
    failures: list[object] = []

    def work(which: int) -> None:
        for number in range(50):
            port.write_registers(which, [number])
            if port.read_holding(which, 1) != [number] or port.read_input(which, 1) != [7 * which + 1]:
                failures.append((which, number))

    threads = [threading.Thread(target=work, args=(which,)) for which in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []


def test_both_send_the_same_bytes(bank) -> None:
    seen: dict[str, list[bytes]] = {"tcp": [], "in memory": []}

    def recording(kind: str) -> Callable[..., bytes]:
        def respond(adu: bytes, peer: str = "") -> bytes:
            seen[kind].append(adu)
            return answer(adu, bank)

        return respond

    def talk(device: ModbusPort) -> None:
        device.read_input(3, 10)
        device.write_coils(1, [True, False])
        device.write_registers(5, [1, 2, 3])
        device.identification()
        device.close()

    with serve_in_thread(modbus_server=ModbusTcpServer(recording("tcp"))) as servers:
        talk(open_modbus("127.0.0.1", servers.modbus_port))
    talk(InMemoryModbus(recording("in memory")))
    assert len(seen["tcp"]) == 4
    assert seen["tcp"] == seen["in memory"]


# --- devices that do not answer as they should -------------------------------------------------------------------


def test_no_server_is_reported(dead_port: int) -> None:
    with pytest.raises(
        LinkLost, match=rf"no Modbus device answers at 127\.0\.0\.1:{dead_port}; check that the rig runs"
    ):
        open_modbus("127.0.0.1", dead_port)


def test_a_silent_device_costs_one_timeout_and_its_late_answer_is_not_taken_for_the_next(bank) -> None:
    late = threading.Event()

    def respond(adu: bytes, peer: str) -> bytes | None:
        return None if not late.is_set() else answer(adu, bank)

    with serve_in_thread(modbus_server=ModbusTcpServer(respond)) as servers:
        device = open_modbus("127.0.0.1", servers.modbus_port, timeout=0.2)
        start = time.monotonic()
        with refuses(LinkLost, "registers 0"):
            device.read_input(0, 1)
        assert 0.15 < time.monotonic() - start < 0.5
        late.set()
        assert device.read_input(1, 1) == [8], "the next call reconnects"
        device.close()


def test_the_rest_of_a_late_answer_is_not_taken_for_the_next(bank) -> None:
    """Half an answer comes in time, the rest when the next request is out."""
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(2)

    def serve() -> None:
        first, _ = listener.accept()
        with first:
            first.settimeout(2)
            reply = answer(first.recv(300), bank)
            first.sendall(reply[:5])
            if request := first.recv(300):
                first.sendall(reply[5:] + answer(request, bank))
        second, _ = listener.accept()
        with second:
            second.settimeout(2)
            second.sendall(answer(second.recv(300), bank))

    thread = threading.Thread(target=serve)
    thread.start()
    device = open_modbus("127.0.0.1", listener.getsockname()[1], timeout=0.2)
    with pytest.raises(LinkLost):
        device.read_input(0, 1)
    assert device.read_input(1, 1) == [8]
    device.close()
    thread.join()
    listener.close()


def test_a_device_that_goes_away(bank) -> None:
    servers = serve_in_thread(modbus_server=ModbusTcpServer(lambda adu, peer: answer(adu, bank)))
    device = open_modbus("127.0.0.1", servers.modbus_port)
    assert device.read_input(0, 1) == [1]
    servers.stop()
    for _ in range(2):
        with refuses(LinkLost, "registers 0"):
            device.read_input(0, 1)
    with serve_in_thread(
        modbus_server=ModbusTcpServer(lambda adu, peer: answer(adu, bank)), modbus_port=servers.modbus_port
    ):
        assert device.read_input(0, 1) == [1]
    device.close()


@pytest.mark.parametrize(
    "reply",
    [
        lambda adu: adu[:7] + b"\x04\x02\x00",  # the length in the header says more
        lambda adu: adu[:4] + b"\0\5" + adu[6:7] + b"\x04\x04\x00\x01",  # announces two registers, sends one
        lambda adu: (
            adu[:4] + b"\0\7" + adu[6:7] + b"\x04\x04\x00\x01\x00\x02"
        ),  # two registers, one was asked for
        lambda adu: b"\xff\xff" + answer(adu, SILENT)[2:],  # another transaction
        lambda adu: adu[:4] + b"\0\3" + adu[6:7] + b"\x04\x00",  # no registers
        lambda adu: b"HTTP/1.1 400 Bad Request\r\n\r\n",
        lambda adu: b"",
    ],
)
def test_nonsense_is_an_error_and_never_a_value(reply: Callable[[bytes], bytes]) -> None:
    class Talker:
        def __init__(self) -> None:
            self.listener = socket.create_server(("127.0.0.1", 0))
            self.listener.settimeout(2)

        def run(self) -> None:
            connection, _ = self.listener.accept()
            with connection:
                connection.settimeout(2)
                request = connection.recv(300)
                if data := reply(request):
                    connection.sendall(data)
                    with contextlib.suppress(OSError):
                        connection.recv(1)  # until the client has had enough

    talker = Talker()
    thread = threading.Thread(target=talker.run)
    thread.start()
    device = open_modbus("127.0.0.1", talker.listener.getsockname()[1], timeout=0.15)
    try:
        with refuses(LinkLost, "registers 0"):
            device.read_input(0, 1)
    finally:
        device.close()
        thread.join()
        talker.listener.close()


class _Silent:
    @staticmethod
    def read_input(address: int, count: int) -> list[int]:
        return [1] * count


SILENT = _Silent()
