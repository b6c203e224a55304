"""python command.py 127.0.0.1:15020 interface=socketcand channel=vcan0 host=127.0.0.1 port=29536 tcp_tune=True"""

import csv
import sys
import threading
import time
from pathlib import Path

import can
import cantools
from pymodbus.client import ModbusTcpClient

database = cantools.database.load_file("astb.dbc")
with Path("map.csv").open() as file:
    address = {(row["space"], row["signal"]): int(row["address"]) for row in csv.DictReader(file)}
host, port = sys.argv[1].split(":")
plc = ModbusTcpClient(host, port=int(port), timeout=1, retries=0)
bus = can.Bus(**dict(option.split("=") for option in sys.argv[2:]))
received = {}
notifier = can.Notifier(bus, [lambda frame: received.__setitem__(frame.arbitration_id, frame)])


def crc8(data_id, data):
    """AUTOSAR E2E profile 1: SAE-J1850, from 0, over the data id and all bytes but the CRC."""
    crc = 0
    for byte in (data_id & 0xFF, data_id >> 8, *data[1:]):
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc


def checked(reply):
    if reply.isError():
        raise SystemExit(f"the rig refused: {reply}")
    return reply


def value_of(message, signal):
    frame = database.get_message_by_name(message)
    return frame.decode(received[frame.frame_id].data)[signal] if frame.frame_id in received else None


def reach(message, signal, good):
    for _ in range(200):
        checked(plc.write_register(address["holding", "modbus.watchdog"], 1000))  # ms; feeds it as well
        if (value := value_of(message, signal)) is not None and good(value):
            return print(f"{signal} = {value}")
        time.sleep(0.05)
    raise SystemExit(f"{signal} = {value_of(message, signal)} after 10 s")


def enter(state):
    reach("State", "rig_state", lambda now: now == state)


def stream():
    counter, due = 0, time.monotonic()
    while running.is_set():
        for name, values in commands.items():
            message = database.get_message_by_name(name)
            data = bytearray(message.encode({"e2e_crc": 0, "e2e_counter": counter, **values}))
            attributes = message.dbc.attributes
            bound = attributes["E2EToken"].value == "data id"
            data[0] = crc8(attributes["E2EDataID"].value ^ (token if bound else 0), data)
            bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))
        counter, due = (counter + 1) % 15, due + 0.02
        time.sleep(max(0.0, due - time.monotonic()))


assert plc.connect(), "no rig answers"
# the bench, and a watchdog of 1000 ms
checked(plc.write_registers(address["holding", "modbus.lease"], [1, 1000]))
token = checked(plc.read_holding_registers(address["holding", "modbus.lease"], count=1)).registers[0]
control = {
    "control_enable": 1,
    "control_hold": 0,
    "control_active": 0,
    "control_reset": 0,
    "control_token": token,
}
platform = {f"platform_{axis}_setpoint": 0.0 for axis in ("vertical", "lateral", "roll")}  # mm, mm, mrad
commands = {"Control": control, "PlatformSetpoints": platform}
running = threading.Event()
running.set()
streaming = threading.Thread(target=stream)
streaming.start()
try:
    enter("DISABLED")
    control["control_reset"] = 1
    enter("AIR_LOW")
    control["control_reset"] = 0
    checked(plc.write_coil(address["coil", "action.air_high"], True))
    for state, bit in (("AIR_HIGH", "control_hold"), ("HOLD", "control_active")):
        enter(state)
        control[bit] = 1
    enter("ACTIVE")
    platform["platform_vertical_setpoint"] = 5.0
    reach("Platform", "platform_vertical", lambda height: height > 4.8)
    platform["platform_vertical_setpoint"] = 0.0
    reach("Platform", "platform_vertical", lambda height: height < 0.2)
    control["control_enable"] = 0
    enter("DISABLED")
finally:
    running.clear()
    streaming.join()
    plc.write_register(address["holding", "modbus.lease"], 0)
    plc.close()
    notifier.stop()
    bus.shutdown()
