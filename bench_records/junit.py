"""The result as JUnit XML for CI servers: one test case for each check, and one for the run."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

from bench_records.layout import JUNIT, put
from bench_records.result import CheckVerdict, Outcome, Result

# Characters that XML 1.0 does not permit, even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_MET = {True: "met", False: "not met", None: "not judged"}


def junit(result: Result) -> bytes:
    """Return the result as XML: values beyond limits are failures, checks without a value errors.

    Checks that are not available are marked as skipped. The time of a check is the time since the previous one; the
    case of the run has the time after the last. Only a run in real time has a time stamp. The names of suite and cases
    include the parameters and the serial number of the specimen, so that several runs of a plan have different names.
    """
    given = _parameter_text(result)
    failures = result.count(CheckVerdict.FAIL)
    errors = result.count(CheckVerdict.ERROR) + (result.verdict is Outcome.BLOCKED)
    lacking = result.count(CheckVerdict.NOT_AVAILABLE)
    totals = {
        "tests": str(len(result.checks) + 1),
        "failures": str(failures),
        "errors": str(errors),
        "time": f"{result.duration:.3f}",
    }
    root = ET.Element("testsuites", {"name": "astb", **totals})
    stamp = {"timestamp": result.began.removesuffix("Z")} if result.began else {}
    suite = ET.SubElement(
        root, "testsuite", {"name": _text(result.plan + given), **stamp, **totals, "skipped": str(lacking)}
    )
    times = _times(result)
    properties = ET.SubElement(suite, "properties")
    for name, value in (
        ("title", result.title),
        ("rig", result.rig),
        ("specimen type", result.specimen and result.specimen.type),
        ("specimen serial number", result.specimen and result.specimen.serial_number),
        ("specimen drawing", result.specimen and result.specimen.drawing),
        ("seed", result.seed),
        *((f"parameter {name}", text) for name, text in result.parameters.items()),
        *(("warning", text) for text in result.warnings),
        *((f"precondition {one.text}", f"{_MET[one.met]}: {one.found}") for one in result.preconditions),
        ("verdict", result.verdict),
    ):
        if value not in (None, ""):
            ET.SubElement(properties, "property", {"name": name, "value": _text(str(value))})
    named = {"classname": _text(result.plan)}
    last = {"name": _text("run" + given), "time": f"{times[-1]:.3f}"}
    run = ET.SubElement(suite, "testcase", named | last)
    if result.verdict is Outcome.BLOCKED:
        ET.SubElement(run, "error", {"type": "blocked", "message": _text(result.reason)})
    for one, time in zip(result.checks, times, strict=False):
        mine = {"name": _text(one.name + given), "time": f"{time:.3f}"}
        case = ET.SubElement(suite, "testcase", named | mine)
        if one.requirement:
            stated = {"name": "requirement", "value": _text(one.requirement)}
            ET.SubElement(ET.SubElement(case, "properties"), "property", stated)
        story = _text(str(one))
        if one.verdict is CheckVerdict.FAIL:
            ET.SubElement(case, "failure", {"type": "limit", "message": story}).text = _text(one.note)
        elif one.verdict is CheckVerdict.ERROR:
            ET.SubElement(case, "error", {"type": "no value", "message": story}).text = _text(one.note)
        elif one.verdict is CheckVerdict.NOT_AVAILABLE:
            ET.SubElement(case, "skipped", {"message": _text(one.note)})
        else:
            ET.SubElement(case, "system-out").text = "\n".join(filter(None, [story, _text(one.note)]))
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _parameter_text(result: Result) -> str:
    texts = [f"{name}={text}" for name, text in sorted(result.parameters.items())]
    if result.specimen is not None and result.specimen.serial_number:
        texts.append(result.specimen.serial_number)
    given = ", ".join(texts)
    return f" [{given}]" if given else ""


def _times(result: Result) -> list[float]:
    """Return the durations (s) of the checks, and of the run after the last check. A check without a time has the
    duration 0.
    """
    ends = [0.0]
    for one in result.checks:
        ends.append(max(ends[-1], one.at if one.at is not None else -math.inf))
    return [end - start for start, end in pairwise([*ends, max(ends[-1], result.duration)])]


def write_junit(result: Result, directory: Path | str) -> Path:
    """Write ``junit.xml`` to the directory. Return its path."""
    path = Path(directory) / JUNIT
    path.parent.mkdir(parents=True, exist_ok=True)
    put(path, junit(result))
    return path


def _text(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
