"""Publishes the readings of a rig to an MQTT broker, with unit, quality and time. It subscribes to nothing."""

import asyncio
import logging
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final

import msgspec
from aiomqtt import Client, MqttError, ProtocolVersion, Will
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from astb.panel.served_readings import PERIOD, ServedReading, ServedReadings
from astb.panel.watch import Watch
from bench_protocol.units import s
from drivers.errors import BenchError
from drivers.reading import Quality
from drivers.wiring.event_loop import EventLoop

#: The delay between two attempts to connect doubles from the first to the second.
SOONEST: Final = 1 * s
LATEST: Final = 30 * s
#: The broker deletes a retained reading after this time, so no value outlives a killed panel.
EXPIRY: Final = 5 * s
#: A broker reports a panel as offline that has sent nothing for 1.5 times this time.
KEEPALIVE: Final = 10 * s
#: Limit of one request to the broker.
WITHIN: Final = 5 * s
ONLINE, OFFLINE = b"online", b"offline"
# The library also logs what it raises.
logging.getLogger("mqtt").addHandler(logging.NullHandler())


class MqttPublisher:
    """Publishes each measurement of ``watch`` as ``astb/RIG/NAME``, retained, ten times a second.

    It subscribes to nothing. ``say`` gets a line when the broker is lost, and when it is found again. Raises BenchError
    if no broker accepts the first connection.
    """

    def __init__(self, watch: Watch, host: str, port: int, say: Callable[[str], None]) -> None:
        self._readings = ServedReadings(watch)
        self._host, self._port, self._say = host, port, say
        self._topic = "astb/" + re.sub(r"[/+#\0]", "_", watch.rig.name)
        self.url = f"mqtt://{host}:{port}/{self._topic}/#"
        self._properties = Properties(PacketTypes.PUBLISH)
        self._properties.MessageExpiryInterval = int(EXPIRY)
        self._end = asyncio.Event()
        self._loop = EventLoop("MQTT publisher")
        try:
            self._task = self._loop.run(self._start(), 3 * WITHIN)
        except (MqttError, TimeoutError, ValueError) as error:
            self._loop.stop()
            raise BenchError(
                f"no MQTT 5 broker accepts the panel at {host}:{port}: {error or 'no answer'}; start a broker there"
            ) from None

    def close(self) -> None:
        """Publish that no reading is valid any more, and disconnect."""
        with suppress(TimeoutError):
            self._loop.run(self._leave(), 3 * WITHIN)
        self._loop.stop()

    def _client(self) -> Client:
        return Client(
            self._host,
            self._port,
            protocol=ProtocolVersion.V5,
            will=Will(f"{self._topic}/status", OFFLINE, qos=1, retain=True),
            keepalive=int(KEEPALIVE),
            timeout=WITHIN,
        )

    async def _start(self) -> asyncio.Task[None]:
        async with self._client():
            pass
        return asyncio.create_task(self._publish_until_end())

    async def _leave(self) -> None:
        self._end.set()
        await self._task

    async def _publish_until_end(self) -> None:
        """Publish until the end, and connect again after each loss."""
        delay, lost = SOONEST, False
        while not self._end.is_set():
            try:
                async with self._client() as client:
                    if lost:
                        self._say(f"the MQTT broker at {self._host}:{self._port} is back")
                    delay, lost = SOONEST, False
                    await self._publish_all(client)
            except Exception as error:  # after any error, the panel continues
                if not lost:
                    self._say(
                        f"the MQTT broker at {self._host}:{self._port} is lost: {error}; check the broker, the panel "
                        f"tries again at least every {LATEST:g} s"
                    )
                lost = True
            await self._pause(delay)
            delay = min(2 * delay, LATEST)

    async def _publish_all(self, client: Client) -> None:
        status = f"{self._topic}/status"
        await client.publish(status, ONLINE, qos=1, retain=True)
        while not self._end.is_set():
            await self._publish(client, self._readings.now())
            await self._pause(PERIOD)
        await self._publish(client, self._readings.none())
        await client.publish(status, OFFLINE, qos=1, retain=True)

    async def _pause(self, seconds: float) -> None:
        """Wait for ``seconds`` s, or until the publisher is closed."""
        # A cancellation of the task is not reliable: wait_for of Python 3.11 can lose the request.
        with suppress(TimeoutError):
            await asyncio.wait_for(self._end.wait(), seconds)

    async def _publish(self, client: Client, readings: Iterable[ServedReading]) -> None:
        for one in readings:
            topic = f"{self._topic}/{one.signal.name.replace('.', '/')}"
            await client.publish(topic, _payload(one), retain=True, properties=self._properties)


def _payload(reading: ServedReading) -> bytes:
    good = reading.quality is Quality.GOOD
    return msgspec.json.encode(
        {
            "value": reading.value if good else None,
            "unit": reading.signal.unit,
            "quality": "good" if good else "bad",
            "time": reading.time,
        }
    )
