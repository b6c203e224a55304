"""What can go wrong between a test plan and the bench, and whose fault it is."""

from typing import Literal

Fault = Literal["rig", "plan", "link", "record"]


class BenchError(Exception):
    """Something between plan and rig broke; ``fault`` says on whose side: the rig's, the plan's, the link's, or that
    of the record, which is not kept any more.
    """

    fault: Fault = "rig"


class BenchTimeout(BenchError):
    """A bounded wait ended before its condition came true."""


class RigFault(BenchError):
    """The rig left the state that the plan needs; the message carries the rig's own reason, ``fault`` whose it is."""

    def __init__(self, message: str, fault: Fault = "rig") -> None:
        super().__init__(message)
        self.fault = fault


class Refused(BenchError):
    """The rig answered a request with a Modbus exception."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code  #: the Modbus exception code


class MapMismatch(BenchError):
    """The rig speaks another table of signals than these drivers."""


class NotCommander(BenchError):
    """Somebody else holds the bench: there is one commander at a time."""

    fault: Fault = "plan"


class NotAvailable(BenchError):
    """This rig does not have what was asked for; the message names rig, signal and reason."""


class WiringError(ValueError):
    """A wiring cannot be right: the text names file and key, the value, and what would be right."""


class Stale(BenchError):
    """A measurement was asked for while no samples of it arrive."""

    fault: Fault = "link"


class LinkLost(BenchError):
    """A connection to the rig is closed, refused or silent."""

    fault: Fault = "link"


class Misuse(BenchError):
    """The plan asked for something that this bench cannot do in its present state."""

    fault: Fault = "plan"


class NotRecorded(BenchError):
    """Nobody keeps the samples any more: what would be measured now would have no record."""

    fault: Fault = "record"
