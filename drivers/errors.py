"""The errors that the bench raises to a test plan, each with the side at fault."""

from typing import Final, Literal

Fault = Literal["rig", "plan", "link", "record"]

#: Remedy in an error message that states the cause by the state of the rig.
TRY_AGAIN: Final = "remove the cause, then try again"


class BenchError(Exception):
    """An error of the bench. ``fault`` names the side at fault: the rig, the plan, the link or the record."""

    fault: Fault = "rig"


class BenchTimeout(BenchError):
    """A time limit ended before the expected condition was met."""


class RigFault(BenchError):
    """The rig left the state that the plan needs. The message has the rig's own reason."""

    def __init__(self, message: str, fault: Fault = "rig") -> None:
        super().__init__(message)
        self.fault = fault


class Refused(BenchError):
    """The rig rejected a request, for example with a Modbus exception."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code  #: Modbus exception code, or status code of OPC UA


class MapMismatch(BenchError):
    """The rig uses another signal table than these drivers."""


class NotCommander(BenchError):
    """Another client holds the lease: the bench accepts one commander at a time."""

    fault: Fault = "plan"


class NotAvailable(BenchError):
    """This rig lacks the requested signal or function. The message names rig, signal and reason."""


class WiringError(ValueError):
    """An invalid wiring. The text names file and key, the invalid value, and a valid value."""


class Stale(BenchError):
    """A measurement used a signal without new samples."""

    fault: Fault = "link"


class LinkLost(BenchError):
    """A connection to the rig is closed, refused or silent."""

    fault: Fault = "link"


class Misuse(BenchError):
    """The plan requested an action that this bench cannot perform in its present state."""

    fault: Fault = "plan"


class NotRecorded(BenchError):
    """Recording has failed, so further measurements would be lost."""

    fault: Fault = "record"
