"""The OPC UA transport against asyncua's own server, and its errors."""

import asyncio
import contextlib
import itertools
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from asyncua import Server, ua
from asyncua.common.subscription import Subscription

from astb.acceptance.transports import Subject, check_transport
from bench_protocol.clock import RealClock
from drivers.errors import LinkLost, MapMismatch, Refused, WiringError
from drivers.wiring.opcua.transport import OpcUaTransport
from drivers.wiring.transports import open_transport
from tests.refusals import refuses

VARIABLES = {
    "Height": (12340, ua.VariantType.Int32, False),
    "Force": (-1.5, ua.VariantType.Double, False),
    "Ready": (True, ua.VariantType.Boolean, False),
    "Broken": (0.0, ua.VariantType.Double, False),
    "Target": (0, ua.VariantType.Int16, True),
    "Rate": (0.0, ua.VariantType.Float, True),
    "Valve": (False, ua.VariantType.Boolean, True),
    "Beat": (0, ua.VariantType.UInt16, True),
    "Serial": ("Cell 7", ua.VariantType.String, False),
    "Loads": ([1.5, 2.5, 3.5], ua.VariantType.Double, True),
}

POINTS = {
    "height": {"node": "ns=2;s=Height", "scale": 0.001},
    "force": {"node": "ns=2;s=Force"},
    "ready": {"node": "ns=2;s=Ready"},
    "broken": {"node": "ns=2;s=Broken"},
    "target": {"node": "ns=2;s=Target", "subscribe": False},
    "rate": {"node": "ns=2;s=Rate"},
    "valve": {"node": "ns=2;s=Valve", "subscribe": False},
    "beat": {"node": "ns=2;s=Beat"},
    "serial": {"node": "ns=2;s=Serial", "subscribe": False},
}
CELL = {
    "kind": "opcua",
    "every": "20 ms",
    "stale": "500 ms",
    "timeout": "500 ms",
    "patience": "400 ms",
    "points": POINTS,
}


class Cell:
    """asyncua's own server in a thread; `set` changes what it says."""

    def __init__(self) -> None:
        self.url, self.changes = "", 0
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._started.wait(60), "a busy machine takes its time"

    def _run(self) -> None:
        with asyncio.Runner() as runner:  # which ends what the server leaves behind
            self._loop = runner.get_loop()
            runner.run(self._serve())

    async def _serve(self) -> None:
        self._server = Server()
        await self._server.init()
        self._server.set_endpoint("opc.tcp://127.0.0.1:0/cell")
        self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        await self._server.register_namespace("urn:cell")
        for name, (value, kind, writable) in VARIABLES.items():
            node = await self._server.nodes.objects.add_variable(
                ua.NodeId(name, 2), ua.QualifiedName(name, 2), ua.Variant(value, kind)
            )
            if writable:
                await node.set_writable()
        await self._write("Broken", 7.0, ua.StatusCode(ua.StatusCodes.BadSensorFailure))
        await self._server.start()
        port = self._server.bserver._server.sockets[0].getsockname()[1]
        self.url = f"opc.tcp://127.0.0.1:{port}/cell"
        self._over = asyncio.Event()
        self._started.set()
        await self._over.wait()
        await self._server.stop()

    async def _write(self, name: str, value: object, status: ua.StatusCode | None = None) -> None:
        said = ua.DataValue(
            ua.Variant(value, VARIABLES[name][1]),
            StatusCode=status or ua.StatusCode(),
            SourceTimestamp=datetime.now(UTC),
        )
        await self._server.write_attribute_value(ua.NodeId(name, 2), said)

    def set(self, name: str, value: object, status: int | None = None) -> None:
        code = None if status is None else ua.StatusCode(status)
        asyncio.run_coroutine_threadsafe(self._write(name, value, code), self._loop).result(5)

    def get(self, name: str) -> object:
        async def read() -> object:
            return await self._server.get_node(ua.NodeId(name, 2)).read_value()

        return asyncio.run_coroutine_threadsafe(read(), self._loop).result(5)

    def hang_up(self) -> None:
        async def close() -> None:
            for client in list(self._server.bserver.clients):
                client.transport.close()

        asyncio.run_coroutine_threadsafe(close(), self._loop).result(5)

    @property
    def subscriptions(self) -> dict:
        return self._server.iserver.subscription_service.subscriptions

    def drop_subscriptions(self) -> None:
        """Forget all subscriptions without a word; the sessions live on, and reading goes on."""
        service = self._server.iserver.subscription_service
        asyncio.run_coroutine_threadsafe(
            service.delete_subscriptions(list(self.subscriptions)), self._loop
        ).result(5)

    def stop(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._over.set)
            self._thread.join(10)


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[Cell]:
    cell = Cell()
    yield cell
    cell.stop()


@pytest.fixture
def cell(shared_cell: Cell) -> Cell:
    """A server in its initial state: starting one takes seconds."""
    for name, (value, _, _) in VARIABLES.items():
        shared_cell.set(name, value, ua.StatusCodes.BadSensorFailure if name == "Broken" else None)
    return shared_cell


@pytest.fixture
def connected() -> Iterator[Callable]:
    with contextlib.ExitStack() as stack:

        def connect(cell: Cell, **changes: object) -> OpcUaTransport:
            transport = OpcUaTransport("cell", {**CELL, "url": cell.url, **changes})
            stack.callback(transport.close)
            transport.heard = []
            transport.subscribe(lambda time, points: transport.heard.append((time, dict(points))))
            transport.connect(RealClock(), pytest.fail, within=2.0)
            return transport

        yield connect


@pytest.mark.slow
def test_it_conforms_with_a_foreign_server(cell: Cell, dead_port: int) -> None:
    def make(url: str = cell.url) -> OpcUaTransport:
        return open_transport("cell", {**CELL, "url": url}, Path())

    subject = Subject(
        make,
        readable=("height", "force", "ready", "target", "rate"),
        written={"target": "target", "valve": "valve"},
        streamed={"rate": "rate"},
        unavailable="broken",
        refused="force",
        nobody=lambda: make(f"opc.tcp://127.0.0.1:{dead_port}"),
        cut=cell.hang_up,
    )
    findings = check_transport(subject)
    assert [str(finding) for finding in findings if finding.breach or finding.skipped] == []


def test_numbers_of_a_foreign_server(cell: Cell, connected: Callable, eventually: Callable) -> None:
    transport = connected(cell)
    found = transport.read(["height", "broken", "ready", "force", "serial"])
    assert math.isnan(found.pop("broken"))
    assert math.isnan(found.pop("serial"))
    assert found == {"height": 12.34, "ready": 1.0, "force": -1.5}
    assert transport.text("serial") == "Cell 7"
    cell.set("Height", -5)
    eventually(lambda: any(points.get("height") == -0.005 for _, points in transport.heard))
    cell.set("Force", 3.0, ua.StatusCodes.UncertainLastUsableValue)
    eventually(lambda: any(math.isnan(points.get("force", 0.0)) for _, points in transport.heard))
    cell.set("Broken", 2.0)
    eventually(lambda: any(points.get("broken") == 2.0 for _, points in transport.heard))


def test_what_does_not_change_stays_fresh_while_the_server_answers(cell: Cell, connected: Callable) -> None:
    transport = connected(cell)
    time.sleep(0.5)
    times = [time for time, points in transport.heard if points.get("height") == 12.34]
    assert len(times) >= 10
    assert max(b - a for a, b in itertools.pairwise(times)) < 0.3e9


def test_a_subscription_that_the_server_drops_is_noticed_and_renewed(
    cell: Cell, connected: Callable, eventually: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its session lives and answers all the while: old values must not count as fresh."""
    transport = connected(cell)
    eventually(lambda: any("height" in points for _, points in transport.heard), within=20.0)
    service = cell._server.iserver.subscription_service
    create = service.create_subscription
    monkeypatch.setattr(service, "create_subscription", None)  # without subscriptions
    dropped = transport._clock.now()
    cell.drop_subscriptions()
    cell.set("Height", 777)
    time.sleep(0.4)
    assert transport.read(["height"]) == {"height": 0.777}
    after = [at for at, points in transport.heard if points.get("height") == 12.34 and at > dropped + 2e8]
    assert after == [], "a value of before is not handed on as one of now"
    monkeypatch.setattr(service, "create_subscription", create)
    eventually(lambda: any(points.get("height") == 0.777 for _, points in transport.heard), within=20.0)
    cell.set("Height", 778)
    eventually(lambda: any(points.get("height") == 0.778 for _, points in transport.heard), within=20.0)
    assert len(cell.subscriptions) == 1
    (remark,) = [one for one in transport.remarks() if "dropped the subscription 1 times" in one.text]
    assert remark.doubtful


def test_a_subscription_that_cannot_be_renewed_is_a_lost_connection(
    cell: Cell, eventually: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost: list[str] = []
    transport = OpcUaTransport("cell", {**CELL, "url": cell.url})
    transport.connect(RealClock(), lost.append, within=2.0)
    monkeypatch.setattr(cell._server.iserver, "max_subscriptions", 0)
    cell.drop_subscriptions()
    eventually(lambda: lost, within=20.0)
    assert "BadTooManySubscriptions" in lost[0]
    transport.close()


@pytest.mark.parametrize("revised", ["interval", "keep-alive"])
def test_values_that_are_confirmed_too_rarely_are_refused_with_the_key_that_helps(
    cell: Cell, connected: Callable, monkeypatch: pytest.MonkeyPatch, revised: str
) -> None:
    service = cell._server.iserver.subscription_service
    create = service.create_subscription

    async def slower(params, *rest, **keys):
        if revised == "interval":
            params.RequestedPublishingInterval *= 10
        else:
            params.RequestedMaxKeepAliveCount *= 10
        return await create(params, *rest, **keys)

    monkeypatch.setattr(service, "create_subscription", slower)
    with refuses(MapMismatch, 'every 0.2 s 0.15 s stale "0.6 s"'):
        connected(cell, stale="150 ms")
    transport = connected(cell, stale="600 ms")
    assert transport.period == pytest.approx(0.2)
    assert any("every 0.2 s, less often than every = 0.02 s" in one.text for one in transport.remarks())


def test_numbers_that_do_not_fit_and_what_the_server_refuses(cell: Cell, connected: Callable) -> None:
    transport = connected(cell)
    for points, words in (
        ({"target": 40000}, "target = 40000 does not fit in the server's Int16"),
        ({"target": math.nan}, "target = nan is not a number to write"),
        ({"valve": 2}, r"valve = 2 is not a Boolean"),
        ({"rate": 1e39}, "does not fit in the server's Float"),
    ):
        with pytest.raises(ValueError, match=words):
            transport.write({"beat": 7, **points})
    assert cell.get("Beat") == 0, "nothing is sent if one does not fit"
    transport.write({"target": -2.4, "valve": 1, "rate": 0.5, "beat": 9})
    assert [cell.get(name) for name in ("Target", "Valve", "Rate", "Beat")] == [-2, True, 0.5, 9]
    with pytest.raises(
        Refused, match=r"writing height to cell at .* was refused: Bad(NotWritable|UserAccessDenied)"
    ):
        transport.write({"height": 1})


def test_an_unencodable_streamed_number_is_reported(cell: Cell, connected: Callable) -> None:
    """A silently held one would keep all others of its request at their old values."""
    transport = connected(cell)
    now = transport._clock.now
    with refuses(ValueError, "target 40000 Int16"):
        for _ in range(50):
            transport.stream({"target": 40000, "rate": 2.5}, now())
            time.sleep(0.02)


def test_values_that_the_server_does_not_publish_are_polled(
    cell: Cell, connected: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A server that has too many subscribers already says so item by item."""
    subscribe = Subscription.subscribe_data_change

    async def last_one_refused(self, nodes, **keys):
        told = await subscribe(self, nodes, **keys)
        return [*told[:-1], ua.StatusCode(ua.StatusCodes.BadTooManyMonitoredItems)]

    monkeypatch.setattr(Subscription, "subscribe_data_change", last_one_refused)
    with refuses(Refused, "(BadTooManyMonitoredItems)"):
        connected(cell)


def test_a_text_takes_no_number(cell: Cell, connected: Callable) -> None:
    transport = connected(cell)
    with refuses(ValueError, "serial 1"):
        transport.write({"serial": 1})


def test_an_answer_may_take_its_time_though_the_connection_had_little(cell: Cell) -> None:
    transport = OpcUaTransport("cell", {**CELL, "url": cell.url, "timeout": "2 s"})
    transport.connect(RealClock(), pytest.fail, within=1.0)
    assert transport._client.uaclient._timeout == 2.0
    transport.close()


def test_the_heartbeat_counts_while_set_points_are_streamed(cell: Cell, connected: Callable) -> None:
    transport = connected(cell, alive={"point": "beat", "every": "20 ms"})
    clock = transport._clock
    for _ in range(10):
        transport.stream({"rate": 2.5, "target": math.nan}, clock.now())
        time.sleep(0.02)
    assert cell.get("Rate") == 2.5
    assert cell.get("Beat") >= 4
    time.sleep(0.8)
    stopped = cell.get("Beat")
    time.sleep(0.15)
    assert cell.get("Beat") == stopped, "who streams no more does not look alive"


def test_a_sign_of_life_may_be_a_bit(cell: Cell, connected: Callable) -> None:
    transport = connected(cell, alive={"point": "valve", "every": "100 ms"})
    before = cell.get("Valve")
    time.sleep(0.25)
    assert cell.get("Valve") == before, "no output before the first command"
    transport.begin()
    seen = []
    for _ in range(50):
        seen.append(cell.get("Valve"))
        time.sleep(0.02)
    assert 4 <= sum(a != b for a, b in itertools.pairwise(seen)) <= 12


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"node": "ns=2;s=Heigth"}, "(ns=2;s=Heigth)"),
        ({"node": "ns=2;s=Serial"}, "subscribe false"),
        ({"node": "ns=2;s=Loads"}, "3 index 0 2"),
        ({"node": "ns=2;s=Loads", "index": 3}, "element 3 3 0 2"),
        ({"node": "ns=2;s=Force", "index": 0}, "element 0 not an array remove index"),
        ({"node": "i=85"}, "(i=85) variable"),
        ({"node": "nsu=urn:sell;s=Force"}, "'urn:sell'"),
    ],
)
def test_an_impossible_value_is_reported_at_once(
    cell: Cell, connected: Callable, said: dict, words: str
) -> None:
    points = {name: one for name, one in POINTS.items() if one["node"] != said["node"]}
    with refuses(MapMismatch, words):
        connected(cell, points={**points, "odd": said})


def test_elements_of_an_array_in_a_namespace_by_its_name(cell: Cell, connected: Callable) -> None:
    loads = {f"load_{k}": {"node": "nsu=urn:cell;s=Loads", "index": k, "scale": 2.0} for k in range(3)}
    transport = connected(cell, points={**POINTS, **loads})
    assert transport.read(list(loads)) == {"load_0": 3.0, "load_1": 5.0, "load_2": 7.0}
    transport.write({"load_2": 9.0, "rate": 1.5, "load_0": 1.0})
    assert cell.get("Loads") == [0.5, 2.5, 4.5], "the others are as they were"
    assert cell.get("Rate") == 1.5
    deadline = time.monotonic() + 5
    while transport.read(["load_2"]) != {"load_2": 9.0} and time.monotonic() < deadline:
        time.sleep(0.02)
    transport.stream({"load_1": 6.0}, transport._clock.now())
    while cell.get("Loads")[1] != 3.0 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert cell.get("Loads") == [0.5, 3.0, 4.5]


def test_refused_set_points_are_reported(cell: Cell, connected: Callable) -> None:
    transport = connected(cell)
    transport.stream({"force": 1.0}, transport._clock.now())
    deadline = time.monotonic() + 5
    while transport.refusal is None and time.monotonic() < deadline:
        time.sleep(0.02)
    assert "writing force" in str(transport.refusal.error)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"urls": "x"}, "transports.cell 'urls' 'url'"),
        ({"url": "http://cell"}, "url 'http://cell' \"opc.tcp://127.0.0.1:4840\""),
        ({"every": "often"}, "every 'often'"),
        ({"points": {}}, "points"),
        ({"points": {"height": {"node": "Height"}}}, "height node 'Height'"),
        ({"points": {"height": {"node": "ns=2;s=H", "scale": 0}}}, "scale 0 offset 0"),
        ({"points": {"height": {"scale": 0}}}, "height"),
        ({"points": {"a": {"node": "ns=2;s=H"}, "b": {"node": "ns=2;s=H"}}}, "points ns=2;s=H"),
        ({"alive": {"point": "beet", "every": "1 s"}}, "'beet' 'beat'"),
    ],
)
def test_a_description_that_cannot_be(changes: dict, words: str) -> None:
    with refuses(WiringError, words):
        OpcUaTransport("cell", {**CELL, "url": "opc.tcp://127.0.0.1:4840", **changes})


def test_without_the_library_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "asyncua", None)
    with refuses(WiringError, "'asyncua>=2.1,<3'"):
        open_transport("cell", {**CELL, "url": "opc.tcp://127.0.0.1:4840"}, Path())


def test_a_missing_server_is_reported(dead_port: int) -> None:
    transport = OpcUaTransport("cell", {**CELL, "url": f"opc.tcp://127.0.0.1:{dead_port}"})
    with refuses(LinkLost, "connecting"):
        transport.connect(RealClock(), pytest.fail, within=1.0)
