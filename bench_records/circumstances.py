"""Under which circumstances a run was made: what a reader must know before any figure."""

from collections.abc import Iterator, Mapping
from typing import Any


def circumstances(meta: Mapping[str, Any]) -> list[str]:
    """Return in words what the meta data of a run say of it; nothing for a real rig in real time.

    ``simulated`` (bool), ``time`` ("virtual"), ``effects`` and ``change`` (name to text), ``sealed_effects`` (bool).
    """
    words = []
    if meta.get("simulated"):
        words.append("SIMULATED")
    if meta.get("time") == "virtual":
        words.append("VIRTUAL TIME")
    words += [f"effect {name} = {value}" for name, value in meta.get("effects", {}).items()]
    words += [f"changed {name} = {_shown(value)}" for name, value in meta.get("change", {}).items()]
    if meta.get("sealed_effects"):
        words.append("sealed effects, which nobody is told")
    return words


def flattened(facts: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield what tables within tables say, each with the names that lead to it: ``parameters › sha256``."""
    for key, value in facts.items():
        name = f"{above} \u203a {key}" if above else str(key)
        if isinstance(value, dict):
            yield from flattened(value, name)
        else:
            yield name, value


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_shown(one)}" for key, one in value.items())
    return ", ".join(map(_shown, value)) if isinstance(value, list) else str(value)
