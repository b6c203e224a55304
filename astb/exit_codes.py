"""The exit codes of the command `astb`, and functions that end a command with one."""

from typing import Final, NoReturn

import click

PASS: Final = 0
FAIL: Final = 1  #: a plan judged the product, and a limit is violated
MISUSE: Final = 2  #: the user requested something impossible
BLOCKED: Final = 3  #: the rig or a precondition failed, not the product
INCOMPLETE: Final = 4  #: all measured checks passed, but the rig cannot measure everything
DEVIATES: Final = 6  #: all checks passed, but the rig deviates from the model that ran next to it (`--watch`)
REFUSED: Final = 5  #: the plan trips a limit in a rehearsal, so it must not run on the rig


def misuse(error: Exception | str) -> NoReturn:
    """Print ``error``, and end the command with the exit code for wrong usage.

    An error of the disk ends the command by `blocked` instead.
    """
    from bench_records.disk import NotKept

    if isinstance(error, NotKept):
        blocked(error)
    click.echo(f"astb: {error}", err=True)
    raise click.exceptions.Exit(MISUSE)


def blocked(error: Exception | str) -> NoReturn:
    """Print ``error``, and end the command with the exit code for a failure of the rig or of a precondition."""
    words = error.strerror if isinstance(error, OSError) and error.strerror else error
    click.echo(f"astb: {words}", err=True)
    raise click.exceptions.Exit(BLOCKED)
