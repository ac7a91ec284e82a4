"""The command ``iris-sysid demo``."""

from pathlib import Path

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Output


def demo(
    output: Output = Path("demo-output"),
    force: Force = False,
) -> None:
    """Render a clip, find what is hidden in it, compare. Shows what is left over, beside the truth.

    \b
    Example:
      iris-sysid demo -o demo-output
    """
    from iris_sysid.cli._demo_clip import demo as run_demo

    with _terminal.progress("demo") as report_progress:
        text = run_demo(output, overwrite=force, progress=report_progress)
    typer.echo(text)
