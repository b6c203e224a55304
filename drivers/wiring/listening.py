"""The wiring of somebody who only listens: nothing is sent by itself, so a dead commander does not look alive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from drivers.wiring.astb.keys import KIND
from drivers.wiring.lines import Description, Greetings


def listening(description: Description) -> Description:
    """Return ``description`` without what is sent by itself: signs of life, streamed messages, words on connecting.

    One to a rig that knows one commander at a time does not become him. What a transport of somebody's own sends is its
    own affair: only the keys ``alive`` and ``every`` are left out.
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
