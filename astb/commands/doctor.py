"""`astb doctor`: available and missing components of this machine."""

from pathlib import Path

import click

from astb.commands.options import JSON_OPTION, RIG_OPTION, out_option, read_rig
from astb.doctor import examine_machine
from astb.exit_codes import BLOCKED, PASS
from astb.tables import open_console, open_table, print_json, styled


@click.command("doctor")
@RIG_OPTION
@JSON_OPTION
@out_option("Folder of the runs; it must be writable.")
def doctor_command(rig_named: str | None, as_json: bool, out: Path) -> None:
    """Check this machine for missing components.

    It prints how to install them.

    Exit codes: 0 if ASTB works here, even if optional components are missing, 3 if it does not.
    """
    rig, _ = read_rig(rig_named)
    findings = examine_machine(rig, out)
    if as_json:
        print_json(findings)
    else:
        style = {"fine": "green", "missing": "yellow", "broken": "bold red"}
        table = open_table("this machine", "", "what", "found", "used for", whole=("",))
        for one in findings:
            table.add_row(styled(one.state, style[one.state]), one.name, one.found, one.used_for)
        console = open_console()
        console.print(table)
        for one in findings:
            if one.mend:
                console.print(f"{one.name}: {one.mend}")
    broken = any(one.state == "broken" for one in findings)
    raise click.exceptions.Exit(BLOCKED if broken else PASS)
