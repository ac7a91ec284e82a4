"""The command ``iris-sysid audit``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli.arguments import Force, Output


def audit(
    published: Annotated[Path, typer.Argument(help="Folder with the benchmark's published result files.")],
    output: Output,
    force: Force = False,
) -> None:
    """Derive the published numbers of the IRIS benchmark again. From its own result files; says what differs.

    \b
    Example:
      iris-sysid audit ../shared/data/iris_published -o audit/
    """
    from iris_sysid.benchmark import write_audit

    for path in write_audit(published, output, overwrite=force).values():
        typer.echo(str(path), err=True)
