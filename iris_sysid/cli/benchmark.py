"""The command ``iris-sysid benchmark``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli.arguments import Force, Output

Latent = Annotated[list[str] | None, typer.Option("--latent", help="Runs of a latent pipeline: NAME=CSV.")]
Predictions = Annotated[
    list[str] | None, typer.Option("--predictions", help="What a VLM or classifier named: NAME=CSV, one line a video.")
]
Rows = Annotated[Path | None, typer.Option("--rows", help="Earlier rows.csv: its tables again.")]
Reference = Annotated[str | None, typer.Option(help="Method that the differences of the long table are against.")]
Published = Annotated[Path | None, typer.Option("--audit", help="Derive the published numbers again from this folder.")]


def benchmark(
    output: Output,
    latent: Latent = None,
    predictions: Predictions = None,
    rows: Rows = None,
    audit: Published = None,
    reference: Reference = None,
    force: Force = False,
) -> None:
    """Build the benchmark's tables from flat rows, or audit the published ones. CSV, Markdown, LaTeX, HTML.

    \b
    Example:
      iris-sysid benchmark --latent baseline=iris_baseline.csv -o out/
    """
    from iris_sysid.benchmark import write_audit
    from iris_sysid.benchmark.build import Inputs, build
    from iris_sysid.benchmark.inputs import named_files

    written: dict[str, Path] = {}
    if audit is not None:
        written |= write_audit(audit, output, overwrite=force)
    given = Inputs(named_files(latent or (), "--latent"), named_files(predictions or (), "--predictions"), rows)
    if given.latent or given.predictions or rows is not None or audit is None:
        written |= build(given, output, reference=reference, overwrite=force)
    for path in written.values():
        typer.echo(str(path), err=True)
