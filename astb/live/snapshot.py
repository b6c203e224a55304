"""The visible state of a run at one moment: plain data, in SI, for any display and for JSON."""

import msgspec


class LiveReading(msgspec.Struct, frozen=True):
    """A key reading, and how far it has moved from its first value towards the nearest limit."""

    name: str
    value: float | None  #: SI; None unless it is good
    shown: str  #: the value with its unit as text, or why there is no reading
    used: float | None = None  #: share of the distance from the first reading to the limit: 1 is at the limit
    limit: str = ""  #: the nearest limit, as text


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """A run at one moment; times in s of the bench's clock."""

    plan: str
    rig: str
    operator: str = ""  #: who runs it
    record: str = ""  #: the directory of the record
    time: float  #: since the run began
    state: str  #: of the rig; "unknown" without a recent report
    reason: str = ""  #: reason why it left the states in which plans run
    step: tuple[str, ...] = ()  #: the phases that are open, outermost first
    in_step: float = 0.0
    next: str = ""  #: the next step; "" if it is unknown
    left: float | None = None  #: until the end
    fraction: float = 0.0  #: of the run that is done
    outline: str = ""  #: the earlier run that predicts the next steps
    said: str = ""  #: last message of the plan
    question: str = ""  #: question that waits for an answer
    answers: tuple[str, ...] = ()  #: answers that it allows
    answer_within: float | None = None  #: s until the question expires
    can_hold: bool = True  #: whether the plan has places where it can be held
    cannot_hold: str = ""  #: why it cannot be held from now on, "" if it can
    held: str = ""  #: hold point of the run, "" if it is not held
    hold_wanted_by: str = ""  #: user who requested the hold, at once or at the next possible place
    checks: dict[str, int] = {}  #: number so far, by verdict
    failed: tuple[str, ...] = ()  #: failed checks and checks without a value, as text
    last_check: str = ""
    readings: tuple[LiveReading, ...] = ()
    assumed: int = 0  #: number of limits that ASTB assumes, and the rig does not have
    commands: bool = False  #: whether the rig names this run as the one that commands it
    late: int | None = None  #: late ticks of the rig since the run began; None if not reported
    latest: float | None = None  #: largest delay (s) of a tick since the rig started
    ended: str = ""  #: the verdict, once there is one
