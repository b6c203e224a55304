"""The readings of a rig as an OPC UA server: read-only, with engineering unit, time stamp and status code."""

import asyncio
import logging
from math import nan
from typing import Final

from asyncua import Node, Server, ua

from astb.panel.served_readings import PERIOD, ServedReading, ServedReadings
from astb.panel.watch import Watch
from bench_protocol.units import s
from drivers.errors import BenchError
from drivers.reading import Quality
from drivers.wiring.event_loop import EventLoop

NAMESPACE: Final = "urn:astb:readings"
#: Loading the standard address space takes a second.
START: Final = 30 * s
#: OPC UA status code by quality.
STATUS: Final = {
    Quality.GOOD: "Good",
    Quality.STALE: "BadNoCommunication",
    Quality.MISSING: "BadWaitingForInitialData",
    Quality.UNAVAILABLE: "BadOutOfService",
}
# The library prints warnings about missing encryption, which this server does not offer.
logging.getLogger("asyncua").addHandler(logging.NullHandler())


class OpcUaServer:
    """Serves each measurement of ``watch`` as the variable ``ns=2;s=NAME``, ten times a second. Raises BenchError if
    ``host`` and ``port`` (0: any free port) cannot be used.
    """

    def __init__(self, watch: Watch, host: str, port: int) -> None:
        self._watch = watch
        self._readings = ServedReadings(watch)
        self._loop = EventLoop("OPC UA server")
        try:
            self._server, self._nodes = self._loop.run(self._start(host, port), START)
        except OSError as error:
            self._loop.stop()
            raise BenchError(
                f"OPC UA at {host}:{port} cannot be served: {error.strerror or error}; use a free port "
                "of this machine"
            ) from None
        self._loop.start(self._update())
        assert self._server.bserver is not None
        port = self._server.bserver._server.sockets[0].getsockname()[1]
        self.url = f"opc.tcp://{host}:{port}/astb"

    def close(self) -> None:
        """End the server."""
        self._loop.run(self._server.stop(), START)
        self._loop.stop()

    async def _start(self, host: str, port: int) -> tuple[Server, dict[str, Node]]:
        server = Server()
        await server.init()
        server.allow_remote_admin(False)  # else a client with the name "admin" could write
        server.set_endpoint(f"opc.tcp://{host}:{port}/astb")
        server.set_server_name(f"ASTB {self._watch.rig.name}")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace(NAMESPACE)
        folder = await server.nodes.objects.add_folder(space, self._watch.rig.name)
        nodes = {}
        for one in self._watch.shown:
            node = await folder.add_variable(
                ua.NodeId(one.name, space), one.label, nan, ua.VariantType.Double
            )
            unit = ua.EUInformation(DisplayName=ua.LocalizedText(one.unit))
            await node.add_property(0, "EngineeringUnits", unit)
            nodes[one.name] = node
        await self._write(server, nodes)  # without it, the first values would have the status Good
        await server.start()
        return server, nodes

    async def _write(self, server: Server, nodes: dict[str, Node]) -> None:
        for one in self._readings.now():
            await server.write_attribute_value(nodes[one.signal.name].nodeid, _data(one))

    async def _update(self) -> None:
        while True:
            await asyncio.sleep(PERIOD)
            await self._write(self._server, self._nodes)


def _data(reading: ServedReading) -> ua.DataValue:
    """Return the value of a reading, with status code and time of measurement."""
    return ua.DataValue(
        ua.Variant(reading.value, ua.VariantType.Double),
        StatusCode=ua.StatusCode(getattr(ua.StatusCodes, STATUS[reading.quality])),
        SourceTimestamp=reading.time,
    )
