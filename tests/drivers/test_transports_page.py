"""The page of what transports accept: each of its rows is a test of quirky devices."""

import importlib

from tools.generate.readers_page import table

#: Where the tests are whose names the rows have.
_MODULES = {
    "quirky_modbus": "tests.wires.test_quirky_modbus",
    "modbus_serial_lines": "tests.wires.test_modbus_serial_lines",
    "transport_opcua": "tests.wires.test_transport_opcua",
    "strange_frames": "tests.drivers.test_strange_frames",
    "stamps": "tests.drivers.test_stamps",
    "before_commanding": "tests.drivers.test_before_commanding",
}


def test_every_row_of_the_page_is_a_test() -> None:
    rows = [one.name.partition(": ") for one in table("transports").forms]
    missing = [
        f"{module}: {name}"
        for module, _, name in rows
        if not callable(getattr(importlib.import_module(_MODULES[module]), f"test_{name}", None))
    ]
    assert missing == []
    assert len({name for _, _, name in rows}) == len(rows)
