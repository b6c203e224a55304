"""The computations of the campaigns of these tests, in a separate module that workers import."""

import os
import time
from pathlib import Path


def square(number: int) -> dict:
    return {"square": number * number}


def whatever(what: str) -> dict:
    """Do the requested action, which fails in most cases."""
    match what:
        case "raise":
            raise ValueError("this case\nraises")
        case "leave":
            raise SystemExit(1)
        case "die":
            os._exit(1)
        case "linger":
            while True:
                time.sleep(0.01)
        case "text":
            return {"length": "four"}
        case "number":
            return 6  # type: ignore[return-value]
        case "renames":
            return {"key": "fine", "length": 7}
        case "unkept":
            return {"length": 5, "thing": object()}
    return {"length": len(what)}


def seen(case: tuple[str, str, float]) -> dict:
    """Take a while, and leave a line for every time that the case was begun."""
    directory, name, seconds = case
    with (Path(directory) / name).open("a") as file:
        file.write("begun\n")
    time.sleep(seconds)
    return {"name": name}
