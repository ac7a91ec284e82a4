"""Options in groups: a dataclass of options is one parameter of a command and one option per field on the terminal."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from typing import Any, get_type_hints

from typer.models import OptionInfo


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for each field of its parameters that are dataclasses.

    Every field has a default and a typer annotation. The function returned has one keyword per option, which typer
    reads; it calls the command with the groups filled in.
    """
    hints = get_type_hints(command, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if is_dataclass(kind) and isinstance(kind, type)}
    options: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        options += _fields_of(groups[parameter.name]) if parameter.name in groups else [_keyword(parameter, hints)]

    @wraps(command)
    def called(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        command(**values)

    called.__annotations__ = {option.name: option.annotation for option in options}
    called.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    return called


def _keyword(parameter: inspect.Parameter, hints: dict[str, Any]) -> inspect.Parameter:
    return parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[parameter.name])


def _fields_of(group: Any) -> list[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    defaults = _defaults(group)
    return [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hints[name])
        for name, default in defaults.items()
    ]


def _defaults(group: Any) -> dict[str, Any]:
    return {
        field.name: field.default if field.default_factory is MISSING else field.default_factory()
        for field in fields(group)
    }


def _options(group: Any) -> dict[str, str]:
    """The option of each field of a group, ``--set``."""
    names = {}
    for name, hint in get_type_hints(type(group), include_extras=True).items():
        (option,) = (item for item in hint.__metadata__ if isinstance(item, OptionInfo))
        texts = (option.default, *(option.param_decls or ()))  # typer keeps the first name as a default here
        stated = next((text for text in texts if isinstance(text, str) and text.startswith("--")), None)
        names[name] = stated or f"--{name.replace('_', '-')}"
    return names


def typed(*groups: Any, **more: object) -> dict[str, Any]:
    """The options of groups by their names on the terminal (``start_at``), and more, for the origin of results."""
    options = more | {
        option.removeprefix("--").replace("-", "_"): getattr(group, name)
        for group in groups
        for name, option in _options(group).items()
    }
    return {name: None if value == [] else value for name, value in options.items()}


def as_typed(*groups: Any, leave_out: tuple[str, ...] = ()) -> list[str]:
    """The options of groups that differ from their defaults, as they are typed; ``leave_out`` names fields."""
    texts: list[str] = []
    for group in groups:
        defaults = _defaults(group)
        for name, option in _options(group).items():
            value = getattr(group, name)
            if name in leave_out or value == defaults[name]:
                continue
            for item in value if isinstance(value, list) else [value]:
                texts += [option] if item is True else [option, str(item)]
    return texts
