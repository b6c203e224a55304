"""The readings as an OPC UA server: values, units, quality and time for any client, and no way to write."""

import asyncio
import math
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any

import pytest
from asyncua import Client, Node, ua

from astb.panel.opcua_server import STATUS, OpcUaServer
from astb.panel.served_readings import PERIOD
from drivers.errors import BenchError, LinkLost
from drivers.reading import Quality
from tests.panel.conftest import SAMPLES, PanelProcess
from tests.refusals import refuses


@pytest.fixture(scope="module")
def served(stub_watch) -> Iterator[OpcUaServer]:
    """One server for all tests: it takes a second to start."""
    server = OpcUaServer(stub_watch, "127.0.0.1", 0)
    yield server
    server.close()


def answered(url: str, ask: Callable[[Client], Coroutine[Any, Any, Any]], user: str = "") -> Any:
    """Return what ``ask`` returns for a connected client."""

    async def whole() -> Any:
        client = Client(url)
        if user:
            client.set_user(user)
        async with client:
            return await ask(client)

    with ThreadPoolExecutor(1) as pool:  # a browser of other tests has an event loop in this thread
        return pool.submit(asyncio.run, whole()).result()


async def comes_good(one: Node) -> bool:
    """Wait five seconds at most for a value with the status Good."""
    for _ in range(50):
        if (await one.read_data_value(raise_on_bad_status=False)).StatusCode.is_good():
            return True
        await asyncio.sleep(PERIOD)
    return False


def node(client: Client, name: str) -> Node:
    return client.get_node(f"ns=2;s={name}")


@pytest.mark.parametrize("name", SAMPLES)
def test_a_client_reads_value_unit_quality_and_time(served, name):
    sample, value, unit = SAMPLES[name]

    async def ask(client):
        if sample.quality is Quality.GOOD:
            assert await comes_good(node(client, name))
        data = await node(client, name).read_data_value(raise_on_bad_status=False)
        units = await node(client, name).get_child("0:EngineeringUnits")
        return data, (await units.read_value()).DisplayName.Text

    data, shown = answered(served.url, ask)
    assert shown == unit
    assert data.StatusCode.name == STATUS[sample.quality]
    if sample.quality is Quality.GOOD:
        assert data.Value.Value == pytest.approx(value)
        age = (datetime.now(UTC) - data.SourceTimestamp.replace(tzinfo=UTC)).total_seconds()
        assert sample.age <= age < sample.age + 5.0
    elif data.Value is not None:
        assert data.Value.Value is None or math.isnan(data.Value.Value)


def test_all_measurements_are_listed(served, stub_watch):
    async def ask(client):
        (folder,) = [
            one for one in await client.nodes.objects.get_children() if one.nodeid.NamespaceIndex == 2
        ]
        return {one.nodeid.Identifier for one in await folder.get_variables()}

    assert answered(served.url, ask) == set(stub_watch.row)


@pytest.mark.parametrize("user", ["", "admin", "Admin", "root"])
def test_no_client_writes(served, user):
    async def ask(client):
        one = node(client, "left.height")
        with pytest.raises(ua.UaStatusCodeError):
            await one.write_value(0.5)
        with pytest.raises(ua.UaStatusCodeError):
            await client.nodes.objects.add_variable(2, "mine", 1.0)
        with pytest.raises(ua.UaStatusCodeError):
            await one.set_writable()
        assert await comes_good(one)
        return await one.read_value()

    assert answered(served.url, ask, user) == pytest.approx(12.5)


@pytest.mark.parametrize("error", [LinkLost("silent"), KeyError("a fault of our own")])
def test_a_lost_rig_takes_the_quality_of_its_readings(served, stub_watch, monkeypatch, error):
    """No reading stays good when it can no longer be read, and all are good again afterwards."""

    async def ask(client):
        one = node(client, "left.height")
        assert await comes_good(one)
        monkeypatch.setattr(stub_watch, "lost", error)
        for _ in range(50):
            await asyncio.sleep(PERIOD)
            data = await one.read_data_value(raise_on_bad_status=False)
            if not data.StatusCode.is_good():
                monkeypatch.setattr(stub_watch, "lost", None)
                return await comes_good(one)
        return False

    assert answered(served.url, ask)


def test_a_port_in_use_is_refused_with_its_number(served, stub_watch):
    port = served.url.rsplit(":", 1)[1].partition("/")[0]
    with refuses(BenchError, port):
        OpcUaServer(stub_watch, "127.0.0.1", int(port))


@pytest.mark.slow
@pytest.mark.real_time
def test_the_panel_serves_the_readings_of_its_rig(tmp_path):
    """Through wires, panel and OPC UA: the gas has the temperature of the simulated hall."""

    async def ask(client):
        for _ in range(100):
            data = await node(client, "left.bellows_temperature").read_data_value(raise_on_bad_status=False)
            if data.StatusCode.is_good():
                return data.Value.Value
            await asyncio.sleep(0.2)
        raise AssertionError(data)

    panel = PanelProcess(tmp_path, None, "--opcua", "0")
    try:
        assert 10.0 < answered(panel.printed("OPC UA:"), ask) < 30.0
    finally:
        panel.stop()
