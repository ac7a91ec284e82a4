"""A model by its name: one of the bank, or the user's own, as ``my_models.py:name``."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.registry import MODELS
from iris_sysid.types import OdeModel


def model_named(text: str) -> OdeModel:
    """The model of that name.

    ``FILE.py:NAME`` runs the file, as Python would, and takes the :class:`iris_sysid.types.OdeModel` that it calls
    NAME; anything else is looked up among the registered models.

    Raises
    ------
    DataError
        When the file is not there, fails, or holds no such model.
    UnknownNameError
        When no model of the bank has that name.
    """
    path, separator, name = text.rpartition(":")
    if not separator or not path.endswith(".py"):
        return MODELS[text]
    namespace = _run(Path(path))
    found = namespace.get(name)
    if isinstance(found, OdeModel):
        return found
    models = sorted(key for key, value in namespace.items() if isinstance(value, OdeModel))
    what = "is not there" if name not in namespace else f"is {type(namespace[name]).__name__}, not an OdeModel"
    raise DataError(f"{name!r} {what} in {path}; models in it: {', '.join(models) or 'none'}")


def _run(path: Path) -> dict[str, object]:
    if not path.is_file():
        raise DataError(f"there is no file {path}; give FILE.py:NAME")
    spec = importlib.util.spec_from_file_location(f"_user_models_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise DataError(f"{path} fails with {type(error).__name__}: {error}") from error
    return vars(module)
