"""What holds for all tests: which hold deadlines, which begin first, little garbage to collect, one core for each."""

import gc
import os
import pickle
import signal
import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# As `astb` does, and like it before numpy is loaded: tests and diagnoses use their cores themselves.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A machine that others use is slow now and then: the time of an example says nothing.
settings.register_profile("astb", deadline=None)
settings.load_profile("astb")

HERE = Path(__file__).parent
#: Where tests are, in a directory for each subject.
TESTS = (HERE, HERE.parent / "studies" / "tests")
# The asserts of modules that tests share show their values, as those of the tests do.
pytest.register_assert_rewrite(
    *(f"tests.{one.stem}" for one in HERE.iterdir() if one.stem != "conftest" and one.name != "__pycache__")
)
#: A test with one of these fixtures, or in tests/wires, has deadlines; others carry the mark themselves.
WIRES = HERE / "wires"
RIGS = {"site", "start_rig", "shared_rig", "bench_panel"}
#: Where such tests are. The choice of them alone reads no other directory, which would take longer than some of them.
TIMED, TIMED_ROOMS = (
    " and real_time",
    {"drivers", "foreign", "panel", "protocol", "records", "rig", "system", "wires"},
)
#: The directories with the longest files, which begin first, so that no processor waits for them in the end.
LONG_ROOMS = ("system", "diagnosis", "plans", "benchmarks", "paper", "model")


def complain_of_an_old_environment() -> None:
    """Refuse an environment that lacks what pyproject.toml offers by now, such as plans of other packages."""
    files = (HERE.parent / "pyproject.toml", HERE.parent / "studies" / "pyproject.toml")
    offered = [tomllib.loads(file.read_text())["project"]["entry-points"] for file in files]
    for group, points in (item for one in offered for item in one.items()):
        found = {(one.name, one.value) for one in entry_points(group=group)}
        if lacking := sorted(points.items() - found):
            raise pytest.UsageError(
                f"this environment does not have {lacking} of {group}: run `make .venv/.ready`"
            )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "real_time: holds deadlines of real time; in `make test` it goes before what only computes"
    )
    complain_of_an_old_environment()
    # A suite started with `&` by a script is deaf to Ctrl-C, and so would be every rig and run that it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    room = room_of(collection_path)
    chosen = config.option.markexpr
    if chosen.endswith(TIMED) and collection_path.is_dir() and room and room not in TIMED_ROOMS:
        return True
    # Half of the files have no slow test: to read them takes every process longer than many a test.
    if chosen.startswith("slow") and room and collection_path.suffix == ".py":
        return b"slow" not in collection_path.read_bytes() or None
    return None


def room_of(path: Path) -> str:
    """Return the directory of tests that a path is in; "" for none."""
    inside = [path.relative_to(tests).parts for tests in TESTS if path.is_relative_to(tests)]
    return inside[0][0] if inside and inside[0] else ""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark them before `-m` chooses, and put what takes long first."""
    for item in items:
        if item.path.is_relative_to(WIRES) or RIGS.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("real_time")
        if item.get_closest_marker("real_time") and room_of(item.path) not in TIMED_ROOMS:
            raise pytest.UsageError(
                f"{item.nodeid} holds deadlines: it belongs in one of {sorted(TIMED_ROOMS)}"
            )
    rank = {room: place for place, room in enumerate(LONG_ROOMS)}
    items.sort(key=lambda item: rank.get(room_of(item.path), len(rank)))


def pytest_collection_finish() -> None:
    """Set aside what exists now and stays: a thousand tests and all libraries, 0.2 s in each full collection."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def no_test_hurries_those_after_it(request: pytest.FixtureRequest) -> Iterator[None]:
    """Take back the priority that a test gave this process: what only computes gives way to what holds deadlines."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    yield
    if os.getpriority(os.PRIO_PROCESS, 0) < before and not request.node.get_closest_marker("real_time"):
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, before)


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], Any]], Any]:
    """Make what several tests need once in a whole run, in whichever process asks first: ``once(name, make)``.

    ``make`` is given a folder that stays. What it returns is pickled: each test file gets a separate copy.
    """
    base = tmp_path_factory.getbasetemp()
    place = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "once"

    def made(name: str, make: Callable[[Path], Any]) -> Any:
        from bench_protocol.runtime.file_locks import hold

        folder, kept = place / name, place / f"{name}.pickle"
        folder.mkdir(parents=True, exist_ok=True)
        with (place / f"{name}.lock").open("w") as lock:
            hold(lock, wait=True)
            if not kept.exists():
                kept.write_bytes(pickle.dumps(make(folder)))
            return pickle.loads(kept.read_bytes())

    return made


@pytest.fixture(scope="session")
def chromium() -> str:
    """Where a real browser lies; skipped where there is none."""
    from bench_records import printing

    found = printing.browser()
    if found is None:
        pytest.skip("this machine has no chromium; `apt-get install chromium` brings it")
    return found


@pytest.fixture(scope="session")
def browser(chromium):
    """A real browser, the same for all tests: there can be only one that is commanded in a process."""
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        try:
            yield one
        finally:
            one.close()
