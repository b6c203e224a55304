"""``python -m astb_studies.benchmarks.twin.serving``: the rig of a case in real time on sockets, until it is killed."""

import threading
from pathlib import Path

import click
import msgspec

from astb.rig_file import read
from astb_studies.benchmarks.twin.cases import Case
from astb_studies.benchmarks.twin.rigs import begin
from bench_sim.parameters import load
from bench_sim.rig.process import run_rig
from bench_sim.rig.rig import Rig


@click.command()
@click.argument("case")
@click.option(
    "--rig", "file", type=click.Path(path_type=Path), required=True, help="Rig file with the ports."
)
def main(case: str, file: Path) -> None:
    """Serve the rig of a CASE (JSON), and start its effect at its time."""
    served, ports = msgspec.json.decode(case, type=Case), read(file)
    rig = Rig(load("astb"), seed=served.seed)
    begin(rig, served)
    run_rig(
        rig,
        can="tcp",
        can_port=ports.can.port,
        modbus_port=ports.modbus.port,
        stop=threading.Event(),
        ready=lambda *addresses: click.echo(f"ready {' '.join(addresses)}"),
    )


if __name__ == "__main__":
    main()
