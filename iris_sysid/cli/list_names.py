"""The command ``iris-sysid list``."""

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Json


def list_names(json: Json = False) -> None:
    """List phenomena, models, effects, trackers with their stages, and scenes. Scenes are what can be rendered.

    \b
    Example:
      iris-sysid list
    """
    from iris_sysid.registry import DETECTORS, EFFECTS, LINKERS, MEASURERS, MODELS, PHENOMENA, TRACKERS
    from iris_sysid.synthetic.scene import SCENES

    registries = (PHENOMENA, MODELS, EFFECTS, TRACKERS, DETECTORS, LINKERS, MEASURERS, SCENES)
    rows = [
        {"kind": registry.kind, "name": name, "summary": summary}
        for registry in registries
        for name, summary in registry.summaries().items()
    ]
    _terminal.print_rows(rows, json)
    for reason in (reason for registry in registries for reason in registry.unusable.values()):
        typer.echo(f"warning: {_terminal.one_line(reason)}", err=True)
