"""A wiring that only listens: it sends nothing by itself, so that a dead commander is not taken for a live one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from drivers.wiring.astb.keys import KIND
from drivers.wiring.lines import Description, Greetings


def listening(description: Description) -> Description:
    """Return ``description`` without periodic sending: heartbeats, streamed messages, orders on connecting.

    It never becomes the commander of a rig that has a lease. Of a user's own transport only the keys ``alive`` and
    ``every`` are removed.
    """
    transports = {name: _silent(table) for name, table in description.transports.items()}
    return replace(description, transports=transports, greetings=Greetings((), (), ()))


def _silent(table: Mapping[str, Any]) -> dict[str, Any]:
    if table.get("kind") == KIND:
        return {**table, "commands": False}
    kept = {key: value for key, value in table.items() if key != "alive"}
    messages = kept.get("messages")
    if isinstance(messages, Mapping):
        kept["messages"] = {
            name: {key: value for key, value in one.items() if key != "every"}
            if isinstance(one, Mapping)
            else one
            for name, one in messages.items()
        }
    return kept
