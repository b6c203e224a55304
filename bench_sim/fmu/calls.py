"""The calls of FMI 2.0 and 3.0 that co-simulation needs, under the same method names for both versions. FMPy makes
the calls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import byref
from pathlib import Path
from typing import Any

from bench_sim.fmu.description import Fmu, FmuError


class _Instance:
    """The calls that both FMI versions share. ``fmu`` is the FMPy object of the instance."""

    fmu: Any
    enumeration: str  #: type of which an enumeration is set and read

    def exit_initialization(self) -> None:
        self.fmu.exitInitializationMode()

    def set(self, kind: str, references: Any, values: Sequence[float]) -> None:
        getattr(self.fmu, f"set{self._type(kind)}")(references, values)

    def get(self, kind: str, references: Any) -> Sequence[float]:
        return getattr(self.fmu, f"get{self._type(kind)}")(references)

    def _type(self, kind: str) -> str:
        return self.enumeration if kind == "Enumeration" else kind


class Fmi2(_Instance):
    """The calls of FMI 2.0."""

    enumeration = "Integer"

    def __init__(self, slave: dict[str, str], log: Callable[[str], Any]) -> None:
        from fmpy import calloc, fmi2, free

        def logged(_: Any, __: bytes, status: int, ___: bytes, message: bytes) -> None:
            if status > 0 and message:
                log(message.decode("utf-8", "replace"))

        self.fmu = fmi2.FMU2Slave(**slave)
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(logged)
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        try:
            from fmpy.logging import addLoggerProxy

            addLoggerProxy(byref(self.callbacks))
        except Exception:  # FMPy has no such library for this system: messages lack their numbers
            pass

    def instantiate(self) -> None:
        self.fmu.instantiate(callbacks=self.callbacks)

    def enter_initialization(self, time: float) -> None:
        self.fmu.setupExperiment(startTime=time)
        self.fmu.enterInitializationMode()

    def free(self, component: Any) -> None:
        self.fmu.fmi2FreeInstance(component)

    def set_reals(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi2SetReal(self.fmu.component, references, count, address)

    def get_reals(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi2GetReal(self.fmu.component, references, count, address)

    def do_step(self, time: float, step: float) -> None:
        self.fmu.fmi2DoStep(self.fmu.component, time, step, 0)


class Fmi3(_Instance):
    """The calls of FMI 3.0."""

    enumeration = "Int64"

    def __init__(self, slave: dict[str, str], log: Callable[[str], Any]) -> None:
        from fmpy.fmi3 import FMU3Slave

        def logged(_: Any, status: int, __: bytes, message: bytes) -> None:
            if status > 0 and message:
                log(message.decode("utf-8", "replace"))

        self.logged = logged
        self.fmu = FMU3Slave(**slave)

    def instantiate(self) -> None:
        self.fmu.instantiate(logMessage=self.logged)

    def enter_initialization(self, time: float) -> None:
        self.fmu.enterInitializationMode(startTime=time)

    def free(self, component: Any) -> None:
        self.fmu.fmi3FreeInstance(component)

    def set_reals(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi3SetFloat64(self.fmu.component, references, count, address, count)

    def get_reals(self, references: Any, count: int, address: Any) -> None:
        self.fmu.fmi3GetFloat64(self.fmu.component, references, count, address, count)

    def do_step(self, time: float, step: float) -> None:
        _, ended, _, reached = self.fmu.doStep(time, step)
        if ended:
            raise FmuError(f"the FMU ended the simulation by itself at {reached:g} s")


def load(fmu: Fmu, unpacked: Path, log: Callable[[str], Any]) -> Fmi2 | Fmi3:
    """Load the library of an FMU from its ``unpacked`` folder, and return its calls. ``log`` receives warnings and
    errors.
    """
    slave = {
        "guid": fmu.token,
        "modelIdentifier": fmu.identifier,
        "unzipDirectory": str(unpacked),
        "instanceName": "instance",
    }
    return Fmi2(slave, log) if fmu.version == 2 else Fmi3(slave, log)
