"""Detection of motion: positions and pressures before and after an action."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from astb.acceptance.conformance.report import Notebook
from bench_protocol.signals import Group
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mbar, mm, ms, s

#: Largest motion that arming may cause, and largest change of a pressure.
STILL: Final = 1 * mm
TIGHT: Final = 20 * mbar
#: Time to watch the bench in one state, and time over which noisy readings are averaged.
WATCH: Final = 0.5 * s
OVER: Final = 100 * ms
#: Longest wait for a bench that still moves by itself.
SETTLED_WITHIN: Final = 60 * s
_PLACES: Final = (Group.HEIGHT, Group.DISPLACEMENT, Group.PLATFORM_DISPLACEMENT)
PLACES: Final = tuple(one.name for one in TABLE.signals if one.group in _PLACES)
PRESSURES: Final = tuple(one.name for one in TABLE.signals if one.group is Group.PRESSURE)

#: Times (s) and values (SI) by the name of the signal.
Courses = Mapping[str, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]


def furthest(courses: Courses, names: tuple[str, ...]) -> tuple[str, float]:
    """Return which of ``names`` moves most from the mean of its first `OVER` seconds, and how far (SI).

    Without data, the name is empty and the distance NaN.
    """
    name, far = "", float("nan")
    for one in names:
        if one not in courses:
            continue
        times, values = (part[np.isfinite(courses[one][1])] for part in courses[one])
        if not values.size:
            continue
        window = ((times - times[0]) / OVER).astype(int)
        counts = np.bincount(window)
        whole = counts > counts.max() / 2
        means = np.bincount(window, values)[whole] / counts[whole]
        way = float(np.abs(means - means[0]).max())
        if not way <= far:
            name, far = one, way
    return name, far


def is_still(courses: Courses) -> bool:
    """Return whether no position and no pressure changes by more than half of its limit for arming."""
    way, change = furthest(courses, PLACES)[1], furthest(courses, PRESSURES)[1]
    return not (way > STILL / 2 or change > TIGHT / 2)


def note_still(book: Notebook, what: str, courses: Courses) -> None:
    """Record the largest motion and the largest change of a pressure in ``courses``, under the name ``what``."""
    for kind, names, limit, unit, text in (
        ("heights and displacements", PLACES, STILL, mm, "mm"),
        ("pressures", PRESSURES, TIGHT, bar, "bar"),
    ):
        name, far = furthest(courses, names)
        if not name:
            book.skip(f"{what}: {kind}", "the rig does not report these signals")
            continue
        found = f"{name} by {far / unit:.3f} {text}"
        right = f"by at most {limit / unit:g} {text}"
        book.note(f"{what}: {kind}", far <= limit, found, right, value=far, apart=limit)
