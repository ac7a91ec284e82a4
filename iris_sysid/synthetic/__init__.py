"""The twin: clips of every phenomenon whose truth is known exactly, because they are drawn."""

from iris_sysid.synthetic.board import render_checkerboard
from iris_sysid.synthetic.clip import render_clip
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.synthetic.scene import SCENES
from iris_sysid.synthetic.truth import Truth, read_truth

__all__ = [
    "SCENES",
    "Look",
    "Truth",
    "plan_clip",
    "read_truth",
    "render_checkerboard",
    "render_clip",
]
