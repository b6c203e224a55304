"""Check of this machine: available and missing packages, priority, SocketCAN, ports, tools."""

from __future__ import annotations

import os
import platform
import shutil
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import msgspec

from bench_protocol.clock import RealClock, hurry
from bench_protocol.extras import EXTRAS, install_command
from bench_protocol.runtime import LINUX, processors
from bench_protocol.units import NS, ms, s, us
from bench_records.printing import MEND, NUMBERS_PAGES, browser, browser_version

if TYPE_CHECKING:
    from astb.rig_file import RigFile

#: *fine*; *missing*: the bench works without it, though not everything of it; *broken*: it does not work.
State = Literal["fine", "missing", "broken"]

#: Requirements of a run in real time: see `bench_protocol.clock`.
PRIORITY: Final = 10
NICE: Final = -10
#: Number of sleeps of one tick each that measure the timing of the machine.
NAPS: Final = 300
TICK: Final = round(1 * ms * NS)
#: A machine with later wake-ups does not hold 1 kHz.
LATE: Final = TICK
#: An hour of records at 200 Hz takes some 100 MB.
ROOM: Final = 1e9
CONNECT: Final = 0.3 * s

APT: Final = "apt install"
#: Programs that a user may use next to the bench, the package that contains them, and their purpose.
TOOLS: Final = {
    "mbpoll": ("mbpoll", "tests with a Modbus client from another source"),
    "tshark": ("tshark", "view of the bus traffic, `astb rig --capture-port`"),
    "candump": ("can-utils", "SocketCAN tools: candump, cansend, canplayer"),
}


class MachineCheck(msgspec.Struct, frozen=True):
    """One result of the check."""

    name: str
    state: State
    found: str
    used_for: str
    mend: str = ""


def examine_machine(rig: RigFile, records: Path) -> list[MachineCheck]:
    """Return the available and the missing components of this machine, for ``rig`` and for records in ``records``.

    This takes about half a second. Nothing is changed and nothing leaves the machine, except connections to the
    addresses in the rig file, to test whether a server answers there.
    """
    return [
        _python(),
        *_packages(),
        _compiled_code(),
        _processors(),
        _system(),
        *(_real_time() if LINUX else ()),
        *_ports(rig),
        *_tools(),
        _printing(),
        _room(records),
    ]


def _python() -> MachineCheck:
    right = sys.version_info >= (3, 11)
    return MachineCheck(
        "Python",
        "fine" if right else "broken",
        platform.python_version(),
        "everything",
        "" if right else "install Python 3.11 or newer",
    )


def _system() -> MachineCheck:
    return MachineCheck(
        "operating system",
        "fine" if LINUX else "missing",
        platform.system(),
        "rigs in real time",
        "" if LINUX else "use Linux; virtual time (--virtual), reports and diagnoses work on all systems",
    )


def _real_time() -> Iterator[MachineCheck]:
    """Report the real-time settings of Linux."""
    yield from _priority()
    yield _punctuality()
    yield _socketcan()


def _packages() -> Iterator[MachineCheck]:
    """Yield the checks of the installed packages against the requirements of ASTB, one for each optional extra."""
    from packaging.requirements import Requirement

    wrong, lacking = {}, {}
    for text in metadata.requires("astb") or ():
        one = Requirement(text)
        extra = ""
        if one.marker and not one.marker.evaluate({"extra": ""}):
            extra = next((name for name in EXTRAS if one.marker.evaluate({"extra": name})), "")
            if not extra:  # for development, or for another Python
                continue
        try:
            version = metadata.version(one.name)
        except metadata.PackageNotFoundError:
            version = ""
        if version and one.specifier.contains(version, prereleases=True):
            continue
        if extra:
            lacking[extra] = f"{one.name} {version}".strip()
        else:
            fault = f"{one.name} {version or 'is missing'} (required: {one.specifier})"
            wrong[fault] = f"'{one.name}{one.specifier}'"
    yield MachineCheck(
        "packages",
        "broken" if wrong else "fine",
        "; ".join(wrong) or "all installed, in the required versions",
        "everything",
        f"pip install {' '.join(wrong.values())}" if wrong else "",
    )
    for extra, (purpose, _) in EXTRAS.items():
        yield MachineCheck(
            f"extra {extra}",
            "missing" if extra in lacking else "fine",
            f"{lacking[extra]} is missing" if extra in lacking else "installed",
            purpose,
            install_command(extra) if extra in lacking else "",
        )


def _compiled_code() -> MachineCheck:
    """Report whether machine code can be cached: without a cache every start compiles the model again."""
    from bench_protocol.runtime.binding import NOT_KEPT, folder_of
    from bench_sim.model.orifice import nozzle_flow

    plain = os.environ.get("NUMBA_DISABLE_JIT", "0") not in {"", "0"}
    if plain:
        return MachineCheck(
            "compiled code",
            "missing",
            "switched off by NUMBA_DISABLE_JIT",
            "real time; plain Python is a hundred times slower",
            "unset NUMBA_DISABLE_JIT",
        )
    kept = folder_of(nozzle_flow)
    return MachineCheck(
        "compiled code",
        "fine" if kept else "missing",
        f"kept in {kept}" if kept else NOT_KEPT.partition(";")[0],
        "short start time",
        "" if kept else "set NUMBA_CACHE_DIR to a folder that you may write",
    )


def _can_write(folder: str | Path) -> bool:
    """Return whether a temporary file can be created; permissions alone are not reliable."""
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _processors() -> MachineCheck:
    count = processors()
    return MachineCheck(
        "processors",
        "fine" if count > 1 else "missing",
        f"{count} for this process",
        "a rig and its control program at the same time",
        "" if count > 1 else "use a machine with two processors; virtual time needs one",
    )


def _in_a_thread(attempt: Callable[[], None]) -> str:
    """Return why ``attempt`` fails in a separate thread, which has its own priority; "" if it succeeds."""
    refusal = ""

    def body() -> None:
        nonlocal refusal
        try:
            attempt()
        except (OSError, AttributeError) as error:
            refusal = getattr(error, "strerror", None) or str(error)

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    return refusal


def _priority() -> Iterator[MachineCheck]:
    limits = "/etc/security/limits.d/astb.conf"
    for name, attempt, line, purpose in (
        (
            "real-time priority",
            lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY)),
            f"@USERS - rtprio {PRIORITY}",
            "punctual ticks on a busy machine",
        ),
        (
            "nice",
            lambda: os.setpriority(os.PRIO_PROCESS, 0, NICE),
            f"@USERS - nice {NICE}",
            "priority of the control program over other programs",
        ),
    ):
        refused = _in_a_thread(attempt)
        yield MachineCheck(
            name,
            "missing" if refused else "fine",
            refused.lower() or "granted",
            purpose,
            f"add the line `{line}` to {limits}, with a group of yours for USERS; then log in again"
            if refused
            else "",
        )


def _punctuality() -> MachineCheck:
    late: list[int] = []

    def nap() -> None:
        hurry(PRIORITY)
        clock = RealClock()
        for _ in range(NAPS):
            due = clock.now() + TICK
            clock.sleep_until(due)
            late.append(clock.now() - due)

    _in_a_thread(nap)
    late.sort()
    median, high = late[NAPS // 2], late[NAPS * 99 // 100]
    right = high < LATE
    return MachineCheck(
        "punctuality",
        "fine" if right else "missing",
        f"pauses of 1 ms end {median / NS / us:.0f} us late (median), {high / NS / us:.0f} us (99th percentile)",
        "runs in real time",
        "" if right else "end other programs on this machine, or run in virtual time (--virtual)",
    )


def _socketcan() -> MachineCheck:
    from drivers.can_port import VIRTUAL_INTERFACE

    purpose = "SocketCAN clients; without it CAN uses TCP"
    how = "docs/how-to/install.md"
    interface = Path("/sys/class/net") / VIRTUAL_INTERFACE
    try:
        up = int((interface / "flags").read_text(encoding="ascii"), 16) & 1
    except (OSError, ValueError):
        pass
    else:
        mend = "" if up else f"ip link set {VIRTUAL_INTERFACE} up"
        text = f"{VIRTUAL_INTERFACE} is {'up' if up else 'down'}"
        return MachineCheck("SocketCAN", "fine" if up else "missing", text, purpose, mend)
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (OSError, AttributeError):
        where = "tools/with_vcan.sh runs a command in user-mode Linux"
        if platform.machine() != "x86_64":
            where = f"user-mode Linux exists for x86_64 only, not for {platform.machine()}"
        elif _has_wide_tiles() and not (os.environ.get("CC") or shutil.which("cc")):
            where += ", on this processor with the help of a C compiler: apt install gcc libc6-dev"
        return MachineCheck(
            "SocketCAN", "missing", "not supported by this kernel", purpose, f"{where} ({how})"
        )
    mend = f"ip link add {VIRTUAL_INTERFACE} type vcan && ip link set {VIRTUAL_INTERFACE} up, as root"
    return MachineCheck(
        "SocketCAN",
        "missing",
        f"the interface {VIRTUAL_INTERFACE} is missing",
        purpose,
        mend,
    )


def _has_wide_tiles() -> bool:
    """Return whether the processor has AMX, whose registers user-mode Linux does not support."""
    try:
        return "amx_tile" in Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False


def _ports(rig: RigFile) -> Iterator[MachineCheck]:
    if rig.wiring:
        return
    from astb.session import answers

    is_rig = False
    for name, host, port in (
        ("Modbus", rig.modbus.host, rig.modbus.port),
        ("CAN hub", rig.can.host, rig.can.port),
    ):
        try:
            socket.create_connection((host, port), CONNECT).close()
        except OSError:
            taken = False
        else:
            taken = True
        if taken and name == "Modbus":
            is_rig = answers(rig)
        right = not taken or is_rig
        text = "free" if not taken else "a rig answers" if is_rig else "used by another program"
        yield MachineCheck(
            f"{name} {host}:{port}",
            "fine" if right else "missing",
            text,
            f"the rig {rig.name}",
            ""
            if right
            else f"end that program (`ss -ltnp 'sport = {port}'` names it) or change the rig file",
        )


def _tools() -> Iterator[MachineCheck]:
    for name, (package, purpose) in TOOLS.items():
        path = shutil.which(name)
        yield MachineCheck(
            name,
            "fine" if path else "missing",
            path or "not installed",
            purpose,
            "" if path else f"{APT} {package}",
        )


def _printing() -> MachineCheck:
    purpose = "reports as PDF (--pdf)"
    path = browser()
    if path is None:
        return MachineCheck("Chromium", "missing", "not installed", purpose, MEND)
    number = browser_version(path)
    right = number is not None and number >= NUMBERS_PAGES
    return MachineCheck(
        "Chromium",
        "fine" if right else "missing",
        f"{path}, {'of unknown version' if number is None else f'version {number}'}",
        purpose,
        "" if right else f"version {NUMBERS_PAGES} or newer, or pages have no numbers",
    )


def _room(records: Path) -> MachineCheck:
    there = next(one for one in (records.absolute(), *records.absolute().parents) if one.is_dir())
    free = shutil.disk_usage(there).free
    writable = _can_write(there)
    right = writable and free > ROOM
    return MachineCheck(
        f"disk space in {records}",
        "fine" if right else "missing" if writable else "broken",
        f"{free / 1e9:.3g} GB free" if writable else f"{there} cannot be written",
        "records; one hour needs about 0.1 GB",
        "" if right else "choose another folder with --out DIRECTORY",
    )
