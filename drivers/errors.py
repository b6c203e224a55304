"""Errors between a test plan and the bench, each with the side at fault."""

from typing import Literal

Fault = Literal["rig", "plan", "link", "record"]


class BenchError(Exception):
    """An error between plan and rig. ``fault`` names its side: the rig, the plan, the link, or the record, which is
    no longer written.
    """

    fault: Fault = "rig"


class BenchTimeout(BenchError):
    """A bounded wait ended before its condition came true."""


class RigFault(BenchError):
    """The rig left the state that the plan needs. The message has the rig's own reason, ``fault`` the side at fault."""

    def __init__(self, message: str, fault: Fault = "rig") -> None:
        super().__init__(message)
        self.fault = fault


class Refused(BenchError):
    """The rig answered a request with a Modbus exception."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code  #: the Modbus exception code


class MapMismatch(BenchError):
    """The rig uses another table of signals than these drivers."""


class NotCommander(BenchError):
    """Another client holds the lease: the bench accepts one commander at a time."""

    fault: Fault = "plan"


class NotAvailable(BenchError):
    """This rig lacks the requested signal or function. The message names rig, signal and reason."""


class WiringError(ValueError):
    """An invalid wiring. The text names file and key, the value, and a valid one."""


class Stale(BenchError):
    """A measurement was requested of a signal without new samples."""

    fault: Fault = "link"


class LinkLost(BenchError):
    """A connection to the rig is closed, refused or silent."""

    fault: Fault = "link"


class Misuse(BenchError):
    """The plan requested an action that this bench cannot perform in its present state."""

    fault: Fault = "plan"


class NotRecorded(BenchError):
    """Recording has failed, so that further measurements would be lost."""

    fault: Fault = "record"
