"""A worker without an FMU: it does what each request says."""

import os
import sys
import time
from signal import SIGSEGV

from bench_sim.fmu.process import RequestPipes


def handle(request: tuple[str, object]) -> object:
    what, value = request
    match what:
        case "print":
            print(value, flush=True)  # to the log, as a library would
        case "read":
            return sys.stdin.read()
        case "refuse":
            raise ValueError(value)
        case "crash":
            os.kill(os.getpid(), SIGSEGV)
        case "exit":
            os._exit(int(str(value)))
        case "hang":
            time.sleep(60.0)
    return value


if __name__ == "__main__":
    pipes = RequestPipes()
    while True:
        pipes.answer(handle)
