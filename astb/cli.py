"""The command `astb`: start a rig, run plans on one, show what crosses its wires, make reports.

Exit codes: 0 pass, 1 fail, 2 misuse, 3 blocked (the rig or a precondition broke, not the product),
4 incomplete (what the rig can measure passes, and something is not available on it),
5 refused (rehearsed in virtual time, a plan trips a limit).
A command is imported when it is called (`astb.plugins`): `astb --help` answers at once.
"""

import gc
import sys
import warnings
from typing import Final, NoReturn

import click

from astb.exit_codes import BLOCKED, MISUSE, PASS
from astb.plugins import CommandLine
from astb.terminal import print_safely
from bench_protocol.runtime import NeedsLinux

#: New objects before the youngest are looked through; how often that before the next older ones are, and then all.
#: Python's own numbers but for the last, which is 10 there.
GARBAGE_COLLECTED_AFTER: Final = (700, 10, 100)
#: The module of each command, in the order of `astb --help`; it stands there as NAME_command.
HOMES: Final = {
    "rig": "astb.commands.rig",
    "fault": "astb.commands.fault",
    "run": "astb.commands.run",
    "rehearse": "astb.commands.rehearse",
    "plans": "astb.commands.lists",
    "rigs": "astb.commands.named",
    "specimens": "astb.commands.named",
    "instruments": "astb.commands.named",
    "dimensions": "astb.commands.named",
    "wirings": "astb.commands.named",
    "parameters": "astb.commands.named",
    "demos": "astb.commands.named",
    "effects": "astb.commands.lists",
    "limits": "astb.commands.lists",
    "signals": "astb.commands.lists",
    "report": "astb.commands.run",
    "note": "astb.commands.note",
    "runs": "astb.commands.runs",
    "compare": "astb.commands.runs",
    "trend": "astb.commands.runs",
    "export": "astb.commands.exchange",
    "import": "astb.commands.exchange",
    "diagnose": "astb.commands.diagnosis",
    "investigate": "astb.commands.diagnosis",
    "identify": "astb.commands.diagnosis",
    "doctor": "astb.commands.doctor",
    "completion": "astb.commands.completion",
}


def main() -> NoReturn:
    """Run the command line; errors that people can mend are one sentence, not a traceback."""
    # What imports bring stays to the end: to look through all of it for garbage took 0.16 s of a short command.
    gc.set_threshold(*GARBAGE_COLLECTED_AFTER)
    warnings.formatwarning = lambda message, *_args, **_options: f"astb: {message}\n"
    print_safely()
    try:
        sys.exit(commands(standalone_mode=False) or PASS)
    except click.exceptions.Exit as end:
        sys.exit(end.exit_code)
    except click.Abort:
        click.echo("interrupted", err=True)
        sys.exit(BLOCKED)
    except click.ClickException as error:
        error.show()
        sys.exit(MISUSE)
    except NeedsLinux as error:
        click.echo(f"astb: {error}", err=True)
        sys.exit(BLOCKED)
    except Exception as error:
        # Python would end with 1, which says that the product failed.
        import traceback

        from bench_records.disk import of_the_disk, why

        if of_the_disk(error):
            click.echo(
                f"astb: {getattr(error, 'filename', None) or 'a file'} cannot be written: {why(error)}",
                err=True,
            )
        else:
            traceback.print_exc()
        sys.exit(BLOCKED)


def _tell_version(ctx: click.Context, param: click.Parameter, asked: bool) -> None:
    """Print which software this is, and end."""
    if not asked or ctx.resilient_parsing:
        return
    from importlib.metadata import version

    from astb.software import commit

    known = commit()
    click.echo(f"astb {version('astb')}" + (f" (commit {known})" if known else ""))
    ctx.exit()


@click.group(cls=CommandLine, homes=HOMES, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_tell_version,
    help="Show the version and the commit, and exit.",
)
def commands() -> None:
    """A virtual test bench for railway air springs that behaves like the real rig down to its wires."""
