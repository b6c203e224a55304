"""A snapshot of a run as lines of text for a terminal; it knows nothing but the snapshot."""

from typing import Final

from rich.text import Text

from astb.live.snapshot import LiveReading, Snapshot
from bench_protocol.units import us

_BAR: Final = 12
_CLOSE: Final = 0.9
_NEAR: Final = 0.75
_NAME: Final = 28


def drawn(seen: Snapshot) -> Text:
    """Return the lines: state and steps, what is left and how punctual the rig is, the key readings."""
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"{seen.state:<14}", "bold" if not seen.reason else "bold red")
    text.append(seen.reason and f"{seen.reason}  ", "red")
    text.append(" › ".join(seen.step) or "–", "bold")
    text.append(f"  {seen.in_step:.0f} s")
    if seen.held or seen.hold_wanted_by:
        text.append(f"  held {seen.held}" if seen.held else "  to be held at the next place", "bold yellow")
    text.append("\n")
    text.append(f"{'next':<14}", "dim")
    text.append((seen.next or ("not known" if seen.left is None else "the end")) + "  ")
    text.append(_time_left(seen), "dim")
    text.append(f"\n{'late ticks':<14}", "dim")
    text.append(_punctuality(seen) + "\n", "yellow" if seen.late else "")
    for one in seen.readings:
        _draw_reading(text, one)
    if seen.assumed:
        text.append(f"{seen.assumed} of these limits are assumed, the rig's file does not tell them\n", "dim")
    return text


def _time_left(seen: Snapshot) -> str:
    if seen.left is None:
        return (
            "until this plan was run or rehearsed once" if not seen.outline else f"unlike in {seen.outline}"
        )
    return f"{seen.left:.0f} s to go, as in {seen.outline}"


def _punctuality(seen: Snapshot) -> str:
    if seen.late is None:
        return "the rig does not tell"
    worst = "" if seen.latest is None else f", at most {seen.latest / us:.0f} µs since the rig started"
    return f"{seen.late}{worst}"


def _draw_reading(text: Text, one: LiveReading) -> None:
    text.append(f"{one.name.replace('.', ' ').replace('_', ' '):<{_NAME}}", "dim")
    text.append(f"{one.shown:>14}", "red" if one.value is None else "")
    if one.used is not None:
        style = "red" if one.used >= _CLOSE else "yellow" if one.used >= _NEAR else "green"
        full = min(round(one.used * _BAR), _BAR)
        text.append("  " + "━" * full, style)
        text.append("╌" * (_BAR - full), "dim")
        text.append(f" {100 * one.used:3.0f} % of the way to {one.limit}", "dim")
    text.append("\n")
