"""The calls of FMI 2.0 and 3.0 that a co-simulation needs, under the same names; by FMPy."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import byref
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Opened:
    """An FMU that lies unpacked in ``folder``, and the file ``mark`` for what is going on."""

    folder: str
    mark: str
    version: int
    identifier: str
    token: str
    keeps_state: bool
    once: bool


class Refused(Exception):
    """A call that an FMU refused, in words."""


class Fmi2:
    """The functions of FMI 2.0. ``log`` gets what the FMU says of warnings and errors."""

    def __init__(self, opened: Opened, log: list[str]) -> None:
        from fmpy import calloc, free
        from fmpy.fmi2 import (
            FMU2Slave,
            fmi2CallbackAllocateMemoryTYPE,
            fmi2CallbackFreeMemoryTYPE,
            fmi2CallbackFunctions,
            fmi2CallbackLoggerTYPE,
        )

        def logged(_: Any, __: bytes, status: int, ___: bytes, message: bytes) -> None:
            if status > 0 and message:
                log.append(message.decode("utf-8", "replace"))

        self.fmu = FMU2Slave(
            guid=opened.token,
            modelIdentifier=opened.identifier,
            unzipDirectory=opened.folder,
            instanceName="asked",
        )
        calls = fmi2CallbackFunctions()
        calls.logger = fmi2CallbackLoggerTYPE(logged)
        calls.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        calls.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        try:
            from fmpy.logging import addLoggerProxy

            addLoggerProxy(byref(calls))
        except Exception:  # a system for which FMPy brings no such library: messages lose their numbers
            pass
        self.calls = calls

    def instantiate(self) -> None:
        self.fmu.instantiate(callbacks=self.calls)

    def begin(self, time: float) -> None:
        self.fmu.setupExperiment(startTime=time)
        self.fmu.enterInitializationMode()

    def begun(self) -> None:
        self.fmu.exitInitializationMode()

    def free(self, component: Any) -> None:
        self.fmu.fmi2FreeInstance(component)

    def put(self, kind: str, references: Any, values: Sequence[float]) -> None:
        kind = "Integer" if kind == "Enumeration" else kind
        getattr(self.fmu, f"set{kind}")(references, values)

    def get(self, kind: str, references: Any) -> Sequence[float]:
        kind = "Integer" if kind == "Enumeration" else kind
        return getattr(self.fmu, f"get{kind}")(references)

    def real_input(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi2SetReal(self.fmu.component, references, count, address)

    def real_output(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi2GetReal(self.fmu.component, references, count, address)

    def do_step(self, time: float, step: float) -> None:
        self.fmu.fmi2DoStep(self.fmu.component, time, step, 0)


class Fmi3:
    """The functions of FMI 3.0, under the same names."""

    def __init__(self, opened: Opened, log: list[str]) -> None:
        from fmpy.fmi3 import FMU3Slave

        def logged(_: Any, status: int, __: bytes, message: bytes) -> None:
            if status > 0 and message:
                log.append(message.decode("utf-8", "replace"))

        self.logged = logged
        self.fmu = FMU3Slave(
            guid=opened.token,
            modelIdentifier=opened.identifier,
            unzipDirectory=opened.folder,
            instanceName="asked",
        )

    def instantiate(self) -> None:
        self.fmu.instantiate(logMessage=self.logged)

    def begin(self, time: float) -> None:
        self.fmu.enterInitializationMode(startTime=time)

    def begun(self) -> None:
        self.fmu.exitInitializationMode()

    def free(self, component: Any) -> None:
        self.fmu.fmi3FreeInstance(component)

    def put(self, kind: str, references: Any, values: Sequence[float]) -> None:
        kind = "Int64" if kind == "Enumeration" else kind
        getattr(self.fmu, f"set{kind}")(references, values)

    def get(self, kind: str, references: Any) -> Sequence[float]:
        kind = "Int64" if kind == "Enumeration" else kind
        return getattr(self.fmu, f"get{kind}")(references)

    def real_input(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi3SetFloat64(self.fmu.component, references, count, address, count)

    def real_output(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi3GetFloat64(self.fmu.component, references, count, address, count)

    def do_step(self, time: float, step: float) -> None:
        _, ended, _, reached = self.fmu.doStep(time, step)
        if ended:
            raise Refused(f"it ended the simulation by itself at {reached:g} s")
