"""The command ``iris-sysid list``."""

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Json


def list_names(json: Json = False) -> None:
    """List phenomena, models, effects, trackers and scenes. Scenes are what can be rendered.

    \b
    Example:
      iris-sysid list
    """
    from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA, TRACKERS
    from iris_sysid.synthetic.scene import SCENES

    rows = [
        {"kind": registry.kind, "name": item.name, "summary": item.summary}
        for registry in (PHENOMENA, MODELS, EFFECTS, TRACKERS, SCENES)
        for item in registry.values()
    ]
    _terminal.print_rows(rows, json)
