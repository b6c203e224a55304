"""Another system, as our own packages see it: `python tests/not_linux.py win32 run aw0 --virtual` runs aw0 there.

Only for our own code is something missing; libraries have files for each system. Available:
modules that do not exist (a hook of the import), attributes that modules lack, functions that the C library lacks or
that cannot be asked for, `sys.platform`; on Windows also texts that are cp1252 with two characters at the end of a line
unless said otherwise, names that files cannot have, and files that cannot be renamed or removed while they are open.
"""

import builtins
import ctypes
import io
import os
import select
import signal
import socket
import sys
import types
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OURS = (
    "astb",
    "astb_studies",
    "bench_protocol",
    "bench_records",
    "bench_sim",
    "diagnosis",
    "drivers",
    "test_plans",
)
#: What neither of the two has.
ONLY_LINUX = {
    "os": {
        "eventfd",
        "eventfd_read",
        "eventfd_write",
        "EFD_NONBLOCK",
        "EFD_CLOEXEC",
        "EFD_SEMAPHORE",
        "memfd_create",
        "sched_getaffinity",
        "sched_setaffinity",
        "sched_setscheduler",
        "sched_getscheduler",
        "sched_param",
        "sched_get_priority_max",
        "SCHED_FIFO",
        "SCHED_RR",
        "SCHED_OTHER",
        "posix_fadvise",
        "posix_fallocate",
        "splice",
        "copy_file_range",
        "pidfd_open",
        "getrandom",
        "sendfile",
        "O_TMPFILE",
        "O_PATH",
        "setns",
        "unshare",
    },
    "socket": {
        "AF_CAN",
        "PF_CAN",
        "CAN_RAW",
        "CAN_RAW_FILTER",
        "SO_TIMESTAMPNS",
        "SO_TIMESTAMPING",
        "SO_BINDTODEVICE",
        "MSG_CONFIRM",
        "MSG_NOSIGNAL",
        "MSG_ERRQUEUE",
        "AF_NETLINK",
        "AF_PACKET",
        "AF_VSOCK",
        "SO_PRIORITY",
        "SO_MARK",
        "TCP_USER_TIMEOUT",
        "TCP_QUICKACK",
    },
    "select": {"epoll", "EPOLLIN"},
    "signal": {"SIGRTMIN", "SIGPWR", "sigtimedwait", "sigwaitinfo"},
    "time": {"CLOCK_BOOTTIME", "CLOCK_TAI"},
}
#: What Windows lacks as well.
ONLY_UNIX = {
    "os": {
        "fork",
        "forkpty",
        "getuid",
        "geteuid",
        "getgid",
        "getegid",
        "uname",
        "setpriority",
        "getpriority",
        "nice",
        "killpg",
        "getpgid",
        "getpgrp",
        "setsid",
        "mkfifo",
        "pread",
        "pwrite",
        "preadv",
        "set_blocking",
        "get_blocking",
        "wait",
        "waitid",
        "chown",
        "fchmod",
        "fchown",
        "lchown",
        "getloadavg",
        "sysconf",
        "statvfs",
        "fstatvfs",
        "openpty",
        "ctermid",
        "register_at_fork",
        "PRIO_PROCESS",
        "O_NONBLOCK",
        "O_CLOEXEC",
        "O_NOCTTY",
        "O_DIRECTORY",
        "O_NOFOLLOW",
        "O_SYNC",
        "WNOHANG",
        "fdatasync",
        "sync",
        "pipe2",
        "readv",
        "writev",
        "tcgetpgrp",
        "posix_spawn",
        "initgroups",
    },
    "socket": {
        "AF_UNIX",
        "MSG_DONTWAIT",
        "SO_REUSEPORT",
        "sethostname",
        "SCM_RIGHTS",
        "CMSG_SPACE",
        "CMSG_LEN",
        "recv_fds",
        "send_fds",
    },
    "select": {"poll", "POLLIN", "POLLOUT", "POLLERR", "POLLHUP"},
    "signal": {
        "SIGHUP",
        "SIGQUIT",
        "SIGUSR1",
        "SIGUSR2",
        "SIGKILL",
        "SIGTSTP",
        "SIGCONT",
        "SIGSTOP",
        "SIGCHLD",
        "SIGALRM",
        "SIGPIPE",
        "SIGWINCH",
        "SIGIO",
        "SIGPROF",
        "SIGVTALRM",
        "SIGXCPU",
        "SIGTTIN",
        "SIGTTOU",
        "SIGURG",
        "SIGBUS",
        "SIGTRAP",
        "SIGSYS",
        "pthread_sigmask",
        "pthread_kill",
        "setitimer",
        "getitimer",
        "alarm",
        "pause",
        "siginterrupt",
        "sigpending",
        "sigwait",
        "ITIMER_REAL",
        "SIG_BLOCK",
        "SIG_UNBLOCK",
        "SIG_SETMASK",
    },
    "socketserver": {
        "UnixStreamServer",
        "UnixDatagramServer",
        "ThreadingUnixStreamServer",
        "ThreadingUnixDatagramServer",
        "ForkingMixIn",
    },
    "time": {
        "clock_gettime",
        "clock_gettime_ns",
        "CLOCK_MONOTONIC",
        "CLOCK_REALTIME",
        "pthread_getcpuclockid",
        "tzset",
    },
    "asyncio": {"open_unix_connection", "start_unix_server"},
}
MODULES = {
    "darwin": {"spwd", "nis"},
    "win32": {
        "fcntl",
        "resource",
        "termios",
        "tty",
        "pty",
        "pwd",
        "grp",
        "syslog",
        "crypt",
        "readline",
        "curses",
        "posix",
        "spwd",
        "nis",
    },
}
#: Functions that the C library of macOS lacks.
NOT_ON_MAC = {
    "clock_nanosleep",
    "eventfd",
    "eventfd_write",
    "eventfd_read",
    "prctl",
    "sched_setscheduler",
    "__errno_location",
    "malloc_trim",
    "mallopt",
    "epoll_create1",
    "timerfd_create",
    "mlockall",
    "gettid",
}
FORBIDDEN = set('<>:"|?*\\')
DEVICES = {"con", "prn", "aux", "nul", *(f"{one}{k}" for one in ("com", "lpt") for k in range(1, 10))}


def _is_ours(depth: int = 2) -> bool:
    """Whether the caller belongs to our packages."""
    return sys._getframe(depth).f_globals.get("__name__", "").partition(".")[0] in OURS


def _by_ours() -> str:
    """Return which of our modules called, through `pathlib` and the like; empty if a library did."""
    frame = sys._getframe(2)
    while frame is not None:
        name = frame.f_globals.get("__name__", "")
        if name.partition(".")[0] in OURS:
            return f"{name}:{frame.f_lineno}"
        if name.partition(".")[0] not in {"pathlib", "contextlib", "shutil", __name__}:
            return ""
        frame = frame.f_back
    return ""


def hide(module: types.ModuleType, lacking: set[str], instead: dict[str, object] | None = None) -> None:
    """Let our packages find no attribute that is ``lacking`` in a ``module``, and others ``instead``."""
    given = instead or {}

    class Foreign(types.ModuleType):
        def __getattribute__(self, name: str) -> object:
            if (name in lacking or name in given) and _is_ours():
                if name in given:
                    return given[name]
                raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
            return types.ModuleType.__getattribute__(self, name)

    module.__class__ = Foreign


def become(system: str) -> None:
    """Let our packages be on this ``system``: win32 or darwin."""
    import asyncio
    import socketserver
    import time

    assert not any(name.partition(".")[0] in OURS for name in sys.modules), "too late"
    windows = system == "win32"
    for module in (os, socket, select, signal, socketserver, time, asyncio):
        name = module.__name__
        lacking = ONLY_LINUX.get(name, set()) | (ONLY_UNIX.get(name, set()) if windows else set())
        hide(module, lacking, {"name": "nt"} if windows and module is os else None)
    hide(sys, set(), {"platform": system})
    hide(ctypes, set(), {"CDLL": lambda name, *more, **options: _library(system, name, *more, **options)})
    imported = builtins.__import__

    def hooked(name, given=None, *more, **named):  # type: ignore[no-untyped-def]
        ours = (given or {}).get("__name__", "").partition(".")[0] in OURS
        if ours and name.partition(".")[0] in MODULES[system]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return imported(name, given, *more, **named)

    builtins.__import__ = hooked
    if system == "win32":
        _files_of_windows()


def _library(system: str, name: object, *more: object, **options: object) -> object:
    if system == "win32" and name is None:
        raise TypeError("expected string or bytes-like object, got 'NoneType'")
    library = ctypes.CDLL(name, *more, **options)  # type: ignore[arg-type]

    class Foreign:
        def __getitem__(self, symbol: str) -> object:
            return getattr(self, symbol)

        def __getattr__(self, symbol: str) -> object:
            if symbol in NOT_ON_MAC:
                raise AttributeError(f"dlsym(RTLD_DEFAULT, {symbol}): symbol not found")
            return getattr(library, symbol)

    return Foreign()


def _opened_here() -> set[str]:
    """Return the files that this process has open or mapped."""
    found = set()
    for one in os.listdir("/proc/self/fd"):
        try:
            found.add(os.readlink(f"/proc/self/fd/{one}"))
        except OSError:
            continue
    with open("/proc/self/maps", encoding="utf-8") as file:
        found |= {line.split(maxsplit=5)[5].rstrip("\n") for line in file if len(line.split(maxsplit=5)) > 5}
    return found


def _refuse_name(path: object) -> None:
    if isinstance(path, int):
        return
    for part in Path(os.fsdecode(path)).parts:  # type: ignore[arg-type]
        wrong = FORBIDDEN & set(part.strip("/")) or part.partition(".")[0].lower() in DEVICES
        if wrong or (part not in {".", ".."} and part[-1] in " ."):
            raise OSError(22, "Windows has no such name", str(path))


def _files_of_windows() -> None:
    plain_open = io.open

    def opened(file, mode="r", buffering=-1, encoding=None, errors=None, newline=None, **more):  # type: ignore[no-untyped-def]
        if _by_ours():
            if set(mode) & set("wxa+"):
                _refuse_name(file)
            if "b" not in mode:
                encoding = "cp1252" if encoding in {None, "locale"} else encoding
                newline = "\r\n" if newline is None and set(mode) & set("wxa") else newline
            if not isinstance(file, int) and os.path.isdir(file):
                raise PermissionError(13, "Permission denied", str(file))
        return plain_open(file, mode, buffering, encoding, errors, newline, **more)

    io.open = builtins.open = opened  # type: ignore[assignment]

    def guarded(act, exists_hurts):  # type: ignore[no-untyped-def]
        def acted(*paths, **options):  # type: ignore[no-untyped-def]
            if who := _by_ours():
                there = _opened_here()
                for path in (os.path.realpath(os.fsdecode(one)) for one in paths if not isinstance(one, int)):
                    if path in there or any(one.startswith(path + "/") for one in there):
                        raise PermissionError(13, f"in use by this process, asked by {who}", path)
                if exists_hurts and os.path.exists(paths[1]):
                    raise FileExistsError(17, "Windows renames to no name that exists", str(paths[1]))
            return act(*paths, **options)

        return acted

    plain_os_open, made = os.open, os.mkdir

    def os_opened(path, flags, *more, **options):  # type: ignore[no-untyped-def]
        if _by_ours():
            if os.path.isdir(path):
                raise PermissionError(13, "Permission denied", str(path))
            if flags & os.O_CREAT:
                _refuse_name(path)
        return plain_os_open(path, flags, *more, **options)

    def made_there(path, *more, **options):  # type: ignore[no-untyped-def]
        if _by_ours():
            _refuse_name(path)
        return made(path, *more, **options)

    os.rename, os.replace = guarded(os.rename, True), guarded(os.replace, False)
    os.unlink, os.remove = guarded(os.unlink, False), guarded(os.remove, False)
    os.open, os.mkdir = os_opened, made_there


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    become(sys.argv[1])
    sys.argv = ["astb", *sys.argv[2:]]
    from astb.cli import main

    main()
