"""The command ``iris-sysid schema``."""

from typing import Annotated

import typer


def schema(
    name: Annotated[
        str,
        typer.Argument(
            help="fit, diagnosis, discovery, plan, detection-limits, calibration, origin, group; "
            "measured, clip or parameters of gt."
        ),
    ],
) -> None:
    """Print the JSON Schema of a result file.

    \b
    Example:
      iris-sysid schema fit
    """
    from iris_sysid.io import files, json_documents

    typer.echo(files.json_text(json_documents.schema(name)).rstrip("\n"))
