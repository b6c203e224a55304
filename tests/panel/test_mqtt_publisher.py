"""The readings at Mosquitto: values, units, quality and time for its clients, and no way to command."""

import json
import math
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from astb.exit_codes import MISUSE
from astb.panel import mqtt_publisher
from astb.panel.mqtt_publisher import EXPIRY, MqttPublisher
from bench_protocol.units import ms
from drivers.errors import BenchError, LinkLost
from drivers.reading import Quality
from tests.panel.conftest import SAMPLES, PanelProcess, free_ports
from tests.refusals import refuses

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
pytestmark = pytest.mark.skipif(
    not (MOSQUITTO and shutil.which("mosquitto_sub")),
    reason="mosquitto is not installed (apt install mosquitto mosquitto-clients)",
)


class Broker:
    """Mosquitto on this machine: its port, its log, and its clients."""

    def __init__(self, folder: Path) -> None:
        (self.port,) = free_ports(1)
        self.url, self._log = f"mqtt://127.0.0.1:{self.port}", folder / "mosquitto.log"
        self._settings = folder / "mosquitto.conf"
        self._settings.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\nlog_type all\n")
        self.start()

    def start(self) -> None:
        """Start it, and wait until it listens."""
        assert MOSQUITTO
        self._log.write_text("")
        with self._log.open("w") as log:
            self._process = subprocess.Popen([MOSQUITTO, "-c", self._settings], stdout=log, stderr=log)
        until(lambda: "running" in self.log)

    @property
    def log(self) -> str:
        return self._log.read_text()

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait(10)

    def received(self, topic: str, *options: str) -> list[tuple[str, Any]]:
        """Return what a client receives for ``topic``: topic and content."""
        command = [
            "mosquitto_sub",
            "-V",
            "5",
            "-L",
            f"{self.url}/{topic}",
            "-F",
            "%t %p",
            "-W",
            "5",
            *options,
        ]
        lines = subprocess.run(command, capture_output=True, text=True, check=False).stdout.splitlines()
        return [(name, text) for name, _, text in (line.partition(" ") for line in lines)]

    def reading(self, name: str) -> dict[str, Any]:
        """Return the present message of a reading; {} without one."""
        found = self.received(f"astb/test/{name.replace('.', '/')}", "-C", "1")
        return json.loads(found[0][1]) if found else {}

    def status(self) -> str:
        ((_, text),) = self.received("astb/test/status", "-C", "1")
        return text

    def publish(self, topic: str, text: str) -> None:
        subprocess.run(["mosquitto_pub", "-L", f"{self.url}/{topic}", "-m", text, "-r"], check=True)


def until(condition: Callable[[], object], within: float = 15.0) -> None:
    deadline = time.monotonic() + within
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@contextmanager
def published(watch, broker: Broker, said: list[str]) -> Iterator[MqttPublisher]:
    publisher = MqttPublisher(watch, "127.0.0.1", broker.port, said.append)
    try:
        yield publisher
    finally:
        publisher.close()


@pytest.fixture(scope="module")
def broker(tmp_path_factory) -> Iterator[Broker]:
    one = Broker(tmp_path_factory.mktemp("broker"))
    yield one
    one.stop()


@pytest.fixture
def publisher(stub_watch, broker) -> Iterator[MqttPublisher]:
    with published(stub_watch, broker, []) as one:
        until(lambda: broker.reading("left.height").get("quality") == "good")
        yield one


def test_a_client_reads_value_unit_quality_and_time(publisher, broker):
    for name, (sample, value, unit) in SAMPLES.items():
        told = broker.reading(name)
        assert set(told) == {"value", "unit", "quality", "time"} and told["unit"] == unit
        if sample.quality is Quality.GOOD:
            assert (told["quality"], told["value"]) == ("good", pytest.approx(value))
        else:
            assert (told["quality"], told["value"]) == ("bad", None)
        assert (told["time"] is None) == math.isinf(sample.age)
        if told["time"]:
            age = (datetime.now(UTC) - datetime.fromisoformat(told["time"])).total_seconds()
            assert sample.age <= age < sample.age + 5.0


def test_all_measurements_are_retained_with_the_status(publisher, broker, stub_watch):
    expected = {f"astb/test/{name.replace('.', '/')}" for name in stub_watch.row} | {"astb/test/status"}
    found = broker.received("astb/test/#", "--retained-only", "-C", str(len(expected)))
    assert {topic for topic, _ in found} == expected and ("astb/test/status", "online") in found


@pytest.mark.parametrize("error", [LinkLost("silent"), KeyError("a fault of our own")])
def test_a_lost_rig_takes_the_quality_of_its_readings(publisher, broker, stub_watch, monkeypatch, error):
    monkeypatch.setattr(stub_watch, "lost", error)
    lost = {"value": None, "unit": "mm", "quality": "bad", "time": None}
    until(lambda: broker.reading("left.height") == lost)
    monkeypatch.setattr(stub_watch, "lost", None)
    until(lambda: broker.reading("left.height")["quality"] == "good")


def test_no_message_commands_the_rig(publisher, broker, stub_watch, monkeypatch):
    """The broker logs no subscription of the panel, and a forged value is replaced."""
    orders: list[Any] = []
    for name in ("act", "write", "go_safe"):
        monkeypatch.setattr(stub_watch, name, lambda *given: orders.append(given))
    for topic in ("left/height", "left/height/set", "air/left_mode", "action/reset", "status/set"):
        broker.publish(f"astb/test/{topic}", '{"value": 1.0, "quality": "good"}')
    until(lambda: broker.reading("left.height")["value"] == pytest.approx(12.5))
    panels = {
        line.split()[5]
        for line in broker.log.splitlines()
        if "PUBLISH from" in line and "left/height" in line
    }
    subscribers = {line.split()[-1] for line in broker.log.splitlines() if "Received SUBSCRIBE" in line}
    assert panels and subscribers and not panels & subscribers
    assert not orders


def test_the_end_of_the_panel_leaves_no_valid_reading(stub_watch, broker):
    with published(stub_watch, broker, []):
        until(lambda: broker.reading("left.height").get("quality") == "good")
        assert broker.status() == "online"
    assert broker.status() == "offline"
    assert broker.reading("left.height").get("quality") == "bad"


def test_readings_return_after_an_absence_of_the_broker(stub_watch, tmp_path, monkeypatch):
    monkeypatch.setattr(mqtt_publisher, "SOONEST", 50 * ms)
    broker, said = Broker(tmp_path), list[str]()
    try:
        with published(stub_watch, broker, said):
            until(lambda: broker.reading("left.height").get("quality") == "good")
            broker.stop()
            until(lambda: said)
            assert len(said) == 1 and str(broker.port) in said[0]
            broker.start()
            until(lambda: broker.reading("left.height").get("quality") == "good")
            assert broker.status() == "online"
            assert len(said) == 2
            broker.stop()
            until(lambda: len(said) == 3)
    finally:
        with suppress(ProcessLookupError):
            broker.stop()


def test_a_missing_broker_is_refused_with_its_port(stub_watch):
    (port,) = free_ports(1)
    with refuses(BenchError, str(port)):
        MqttPublisher(stub_watch, "127.0.0.1", port, pytest.fail)


@pytest.mark.parametrize("text", ["1883", ":1883", "here:", "here:0", "here:65536", "here:mqtt"])
def test_a_wrong_address_is_refused(text):
    from click.testing import CliRunner

    from astb.panel.cli import panel_command

    told = CliRunner().invoke(panel_command, ["--mqtt", text])
    assert told.exit_code == MISUSE and repr(text) in told.output


@pytest.mark.slow
@pytest.mark.real_time
def test_the_panel_publishes_the_readings_of_its_rig(tmp_path, broker):
    """Through wires, panel and broker: the gas has the temperature of the simulated hall. A killed panel is offline."""
    panel = PanelProcess(tmp_path, None, "--mqtt", f"127.0.0.1:{broker.port}")
    try:
        assert panel.printed("MQTT:") == f"{broker.url}/astb/test/#"
        until(lambda: broker.reading("left.bellows_temperature").get("quality") == "good", 30.0)
        assert 10.0 < broker.reading("left.bellows_temperature")["value"] < 30.0
        assert broker.status() == "online"
        panel.kill()
        until(lambda: broker.status() == "offline")
        time.sleep(EXPIRY + 1.0)
        assert broker.reading("left.bellows_temperature") == {}
    finally:
        panel.stop()
