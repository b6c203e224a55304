"""Carry out the commands of docs/tutorials/find-a-hidden-effect.md, and write the resulting figures into the page.

python tools/tutorial_hidden_effect.py [DIRECTORY]    results stay in DIRECTORY; existing results are kept
"""

import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from bench_records.result import Check
from bench_records.twin import PARTS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "tutorials" / "find-a-hidden-effect.md"

#: The JSON files that the commands leave, by their name in `FIGURES`.
RESULTS = {
    "screen": "runs/hunt/screening/result.json",
    "found": "runs/found/finding.json",
    "again": "runs/hunt-again/finding.json",
    "log": "runs/hunt-again/investigation.json",
    "rig": "runs/rig/leak_down/result.json",
    "before": "runs/before/leak_down/result.json",
    "after": "runs/after/leak_down/result.json",
}
#: The page omits what follows this in the sentence of a finding.
LACKS = "The model does not contain this effect."
Results = Mapping[str, Any]


def files(page: str) -> dict[str, str]:
    """Return the complete TOML files on the page. The key is the file name in their first line."""
    return {
        name: f"# {name}\n{text}"
        for name, text in re.findall(r"```toml\n# (\S+\.toml)\n(.*?)```", page, flags=re.DOTALL)
    }


def commands(page: str) -> list[list[str]]:
    """Return the arguments of every `astb` command on the page."""
    blocks = re.findall(r"```sh\n(.*?)```", page, flags=re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    return [shlex.split(line)[1:] for line in lines if line.startswith(".venv/bin/astb ")]


def carry_out(page: str, directory: Path) -> None:
    """Run the page's commands in ``directory``. Commands whose results already exist are skipped."""
    for name, text in files(page).items():
        (directory / name).write_text(text)
    for arguments in commands(page):
        if (directory / arguments[arguments.index("--out") + 1]).exists():
            continue
        print("astb", *arguments, flush=True)
        done = subprocess.run([sys.executable, "-m", "astb", *arguments], cwd=directory, check=False)
        if done.returncode not in {0, 1}:  # a rig with a leak fails its leak-down
            raise SystemExit(f"it ended with {done.returncode}")


def _gain(finding: Any, channel: str) -> Any:
    return next(gain for gain in finding["gains"] if gain["channel"] == channel)


def _noise_ratios(finding: Any) -> tuple[str, str]:
    gain = _gain(finding, "all")
    return f"{gain['noise_ratio_before']:.2f}", f"{gain['noise_ratio']:.2f}"


def _errors(finding: Any, channel: str, digits: int) -> tuple[str, str]:
    gain = _gain(finding, channel)
    return f"{gain['rmse_before']:.{digits}f}", f"{gain['rmse_after']:.{digits}f}"


def _candidate(finding: Any, effect: str) -> Any:
    return next(score for score in finding["scores"] if score["effect"] == effect)


def _score(finding: Any, effect: str) -> str:
    return f"{_candidate(finding, effect)['score']:.0f}"


def _outcome(finding: Any, effect: str) -> str:
    return str(_candidate(finding, effect)["outcome"]).replace("-", "\u2212")


def _area(finding: Any, *ends: str, digits: int) -> tuple[str, ...]:
    (area,) = finding["causes"][0]["parameters"]
    return tuple(f"{area[end]:.{digits}f}" for end in ends)


def _volume(finding: Any) -> tuple[str, str, str]:
    shift = next(s for s in finding["shifts"] if s["name"] == "left.auxiliary_volume")
    return f"{shift['before']:.2f}", f"{shift['sd_before']:.2f}", f"{shift['after']:.2f}"


def _candidates(finding: Any) -> str:
    return str(len({score["effect"] for score in finding["scores"]}))


def _cosine(finding: Any, one: str, other: str) -> str:
    effects, cosines = finding["confusability"]["effects"], finding["confusability"]["cosines"]
    return f"{cosines[effects.index(one)][effects.index(other)]:.2f}"


def _smallest(finding: Any, effect: str) -> str:
    return f"{next(one['smallest'] for one in finding['not_seen'] if one['effect'] == effect):.5f}"


def _last_check(result: Any) -> str:
    return str(msgspec.convert(result["checks"][-1], Check))


def _lost(result: Any) -> tuple[str, str]:
    """Return the air loss per minute (%) of the left and the right spring, as text."""
    lost = [100 * c["value"] for c in result["checks"] if c["name"].startswith("air lost")]
    return tuple(f"{value:.2f}".replace("-", "\u2212").replace("\u22120.00", "0.00") for value in lost)


#: A place in the page, with a group for each figure, and what the program says there.
FIGURES: list[tuple[str, Callable[[Results], tuple[str, ...]]]] = [
    (r"```text\n  (screening 6 [^\n]*)\n", lambda r: (_last_check(r["screen"]),)),
    (r"All (\d+) candidates of the catalogue", lambda r: (_candidates(r["found"]),)),
    (
        "".join(rf"{label}: ([^\n]*)\n" for label in PARTS.values()),
        lambda r: tuple(r["found"]["summary"][name] for name in PARTS),
    ),
    (r"95 % interval: ([\d.]+) to ([\d.]+) mm²", lambda r: _area(r["found"], "low", "high", digits=5)),
    (r"error falls from ([\d.]+) to ([\d.]+) times the noise; that", lambda r: _noise_ratios(r["found"])),
    (r"load cell 1\s+from ([\d.]+) to ([\d.]+) N", lambda r: _errors(r["found"], "load_cell.1", 0)),
    (r"above the threshold of ([\d.]+)\.", lambda r: (f"{r['found']['threshold']:.2f}",)),
    (r"\| leak, orifice, left \| (\d+)", lambda r: (_score(r["found"], "leak.left"),)),
    (r"\| leak, laminar, left \| (\d+)", lambda r: (_score(r["found"], "leak_laminar.left"),)),
    (
        r"\| gain of the pressure transmitters \| (\d+) \| ([^|]*) \|",
        lambda r: (_score(r["found"], "pressure_gain"), _outcome(r["found"], "pressure_gain")),
    ),
    (r"found from ([\d.]+) mm² on", lambda r: (_smallest(r["found"], "leak.right"),)),
    (r"cosine of ([\d.]+),", lambda r: (_cosine(r["found"], "leak.left", "leak_laminar.left"),)),
    (
        r"chamber ([\d.]+) litre large,\s+with a standard deviation of ([\d.]+) litre. With the leak it is ([\d.]+)",
        lambda r: _volume(r["found"]),
    ),
    (
        r"# 95 %: ([\d.]+) to ([\d.]+) mm2\narea",
        lambda r: _area(r["found"], "low", "high", digits=6),
    ),
    (r'\narea = "([\d.]+) mm2"\n```\n\nA simulated rig can', lambda r: _area(r["found"], "value", digits=6)),
    (r"\| the rig \| ([\d.−]+) % \| ([\d.−]+) %", lambda r: _lost(r["rig"])),
    (r"\| the model before \| ([\d.−]+) % \| ([\d.−]+) %", lambda r: _lost(r["before"])),
    (r"\| the model after \| ([\d.−]+) % \| ([\d.−]+) %", lambda r: _lost(r["after"])),
    (
        rf"1\. screening, [\d.]+ min, [^:]*: ([^\n]*{LACKS}) …\n",
        lambda r: (r["again"]["sentence"].partition(LACKS)[0] + LACKS,),
    ),
    (r"busy for ([\d.]+) of its 20", lambda r: (f"{sum(s['minutes'] for s in r['log']['steps']):.1f}",)),
]


def with_figures(page: str, results: Results) -> str:
    """Return the page with all figures replaced by those of the ``results``."""
    for pattern, of in FIGURES:
        (match,) = re.finditer(pattern, page)
        for group, text in reversed(list(enumerate(of(results), 1))):
            page = page[: match.start(group)] + text + page[match.end(group) :]
    return page


def main(directory: Path) -> None:
    page = PAGE.read_text()
    carry_out(page, directory)
    results = {name: json.loads((directory / path).read_text()) for name, path in RESULTS.items()}
    PAGE.write_text(with_figures(page, results))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as empty:
            main(Path(empty))
