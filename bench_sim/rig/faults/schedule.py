"""A schedule of actions by tick number, for the start and end of faults. The compiled ticks stop at each of them."""

import heapq
import itertools
from collections.abc import Callable
from typing import Any, Final

Undo = Callable[[], None]
_NEVER: Final = -1


class Schedule:
    """Actions at future ticks. ``controls`` is the record of the tick."""

    def __init__(self, controls: Any) -> None:
        self._controls = controls
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._set_next_tick()

    @property
    def tick(self) -> int:
        """The present tick."""
        return int(self._controls["tick"])

    def at(self, tick: int, do: Callable[[], None]) -> Undo:
        """Call ``do()`` after ``tick``, or after the next tick if ``tick`` has passed. Return a function that cancels
        this.
        """
        number = next(self._order)
        heapq.heappush(self._due, (max(tick, self.tick + 1), number, do))
        self._set_next_tick()

        def cancel() -> None:
            self._due = [one for one in self._due if one[1] != number]
            heapq.heapify(self._due)
            self._set_next_tick()

        return cancel

    def every(self, ticks: int, do: Callable[[], None]) -> Undo:
        """Call ``do()`` after the next tick and then every ``ticks`` ticks. Return a function that ends this."""
        running = True
        cancel: Undo

        def again() -> None:
            nonlocal cancel
            if running:
                do()
                cancel = self.at(self.tick + ticks, again)

        def end() -> None:
            nonlocal running
            running = False
            cancel()

        cancel = self.at(_NEVER, again)
        return end

    def run(self) -> None:
        """Call the actions whose tick has come."""
        while self._due and self._due[0][0] <= self.tick:
            _, _, do = heapq.heappop(self._due)
            do()
        self._set_next_tick()

    def _set_next_tick(self) -> None:
        self._controls["fault_tick"] = self._due[0][0] if self._due else _NEVER
