"""Synthetic clips of every phenomenon: their truth is known exactly, because they are drawn.

Names are imported when first used, so that listing the scenes does not load the renderer.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOME = {
    "SCENES": "iris_sysid.synthetic.scene",
    "Look": "iris_sysid.synthetic.look",
    "Truth": "iris_sysid.synthetic.truth",
    "plan_clip": "iris_sysid.synthetic.plan",
    "read_truth": "iris_sysid.synthetic.truth",
    "render_checkerboard": "iris_sysid.synthetic.board",
    "render_clip": "iris_sysid.synthetic.clip",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'iris_sysid.synthetic' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
