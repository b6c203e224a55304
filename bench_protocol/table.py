"""The table of signals: one row for every value on CAN and Modbus. CAN messages, Modbus registers, the DBC, the codecs,
the map hash, the columns of records and the reference page are generated from it. The attributes of the drivers are
checked against it.
"""

from typing import Final

from bench_protocol.rates import RATES
from bench_protocol.registers import registers_of
from bench_protocol.signals import Kind
from bench_protocol.table_messages import MESSAGES
from bench_protocol.table_signals import SIGNALS
from bench_protocol.wires import Table


def _complete(table: Table) -> Table:
    """Return ``table`` after a check.

    Raises ValueError for a sensor or set-point without a CAN message, and for a message with a rate not in `RATES`.
    """
    for message in table.messages:
        if message.rate not in (0.0, *RATES):
            rates = ", ".join(f"{rate:g}" for rate in RATES)
            raise ValueError(
                f"{message.name}: {message.rate:g} Hz is not a rate of the bench; use one of {rates}"
            )
    carried = {field.signal for message in table.messages for field in message.fields}
    for signal in table.of_kind(Kind.MEASUREMENT, Kind.SETPOINT):
        if signal.name not in carried:
            raise ValueError(
                f"no CAN message carries {signal.name}: give it a field in bench_protocol/table_messages.py"
            )
    return table


TABLE: Final = _complete(Table(SIGNALS, MESSAGES, registers_of(SIGNALS)))
