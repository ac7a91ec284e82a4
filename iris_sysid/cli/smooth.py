"""The command ``iris-sysid smooth``."""

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Columns, Force, Output, RecordArguments, Table


def smooth(table: Table, output: Output, columns: Columns = None, force: Force = False) -> None:
    """Smooth a trajectory and add its velocities. Kalman filter and Rauch-Tung-Striebel; gaps are bridged.

    \b
    Example:
      iris-sysid smooth trajectory.csv -o smoothed.csv
    """
    _terminal.check_sources([table])
    from iris_sysid.io import csv_write
    from iris_sysid.trajectory import smoothing

    _terminal.check_outputs(table, [output], overwrite=force)
    smoothed = smoothing.smooth(*_terminal.read_tables([table], RecordArguments(columns, keep_clipped=True)))
    csv_write.write_trajectory(smoothed, output, overwrite=force)
    state = smoothed.smoothed
    assert state is not None
    for quantity, psd, nis in zip(smoothed.quantities, state.psd, state.nis, strict=True):
        typer.echo(f"{quantity.name}: process noise {psd:.4g} {quantity.unit}^2/s^5, NIS {nis:.2f}", err=True)
    _terminal.suggest("fit", output, "--model", "auto", "-o", output.with_name("fit.json"))
