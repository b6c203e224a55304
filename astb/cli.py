"""The command `astb`, with all its sub-commands.

`astb.exit_codes` lists the exit codes. The module of a command is imported when the command is called
(`astb.plugins`), so that `astb --help` is fast.
"""

import gc
import os
import sys
import warnings
from typing import Final, NoReturn

import click

from astb.exit_codes import BLOCKED, MISUSE, PASS
from astb.plugins import CommandLine
from astb.terminal import print_safely
from bench_protocol.runtime import NeedsLinux

#: Thresholds of the three generations of garbage collection. Only the last differs from Python's default, which is 10.
GARBAGE_COLLECTED_AFTER: Final = (700, 10, 100)
#: The module of each command by heading, in the order of `astb --help`; the module holds it as NAME_command.
HEADINGS: Final = {
    "Run": {
        "run": "astb.commands.run",
        "plans": "astb.commands.lists",
        "rehearse": "astb.commands.rehearse",
        "campaign": "astb.campaigns.cli",
        "watch": "astb.watch.cli",
        "panel": "astb.panel.cli",
    },
    "Rigs": {
        "rig": "astb.commands.rig",
        "list": "astb.commands.named",
        "copy": "astb.commands.named",
    },
    "Records": {
        "runs": "astb.commands.runs",
        "report": "astb.commands.run",
        "note": "astb.commands.note",
        "compare": "astb.commands.runs",
        "trend": "astb.commands.runs",
        "export": "astb.commands.exchange",
        "import": "astb.commands.exchange",
    },
    "Models": {
        "diagnose": "astb.commands.diagnosis",
        "investigate": "astb.commands.diagnosis",
        "identify": "astb.commands.diagnosis",
        "fmu": "astb.fmu.cli",
    },
    "Tools": {
        "doctor": "astb.commands.doctor",
        "completion": "astb.commands.completion",
    },
}


def main() -> NoReturn:
    """Run the command line. Errors that users can correct are printed as one sentence, not as a traceback."""
    # Imported objects stay to the end: collecting garbage among them took 0.16 s of a short command.
    gc.set_threshold(*GARBAGE_COLLECTED_AFTER)
    # Arrow's own allocator keeps 30 MB of the memory in which it wrote a record.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
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
        # Python would end with 1, which means that the product failed.
        import traceback

        from bench_records.disk import disk_reason, of_the_disk

        if of_the_disk(error):
            click.echo(
                f"astb: {getattr(error, 'filename', None) or 'a file'} cannot be written: {disk_reason(error)}",
                err=True,
            )
        else:
            traceback.print_exc()
        sys.exit(BLOCKED)


def _print_version(ctx: click.Context, param: click.Parameter, requested: bool) -> None:
    """Print version and commit, and end."""
    if not requested or ctx.resilient_parsing:
        return
    from importlib.metadata import version

    from astb.software import commit

    known = commit()
    click.echo(f"astb {version('astb')}" + (f" (commit {known})" if known else ""))
    ctx.exit()


@click.group(
    cls=CommandLine, headings=HEADINGS, path="astb", context_settings={"help_option_names": ["-h", "--help"]}
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Print the version and the commit, and exit.",
)
def commands() -> None:
    """Test railway air springs on real or simulated rigs, and find model errors.

    Type astb COMMAND --help for the options of a command.
    """
