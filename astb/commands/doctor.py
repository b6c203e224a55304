"""`astb doctor`: what is available on this machine, what is missing, and how to install that."""

from pathlib import Path

import click

from astb.commands.options import JSON_OPTION, RIG_OPTION, out_option, read_rig
from astb.doctor import examine_machine
from astb.exit_codes import BLOCKED, PASS
from astb.tables import open_console, open_table, print_json, styled


@click.command("doctor")
@RIG_OPTION
@JSON_OPTION
@out_option("Where records would go.")
def doctor_command(rig_named: str | None, as_json: bool, out: Path) -> None:
    """Tell what is available on this machine, what is missing, and how to install that.

    Ends with 0 if the bench works here, though perhaps not everything of it, and with 3 if it does not.
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
