"""Text in CSV cells that a spreadsheet would run as a formula, written with an apostrophe before it (CWE-1236).

Names of bodies, settings and clips come from files that others made; ``=HYPERLINK(...)`` is such a name.
"""

from __future__ import annotations

import re

ALWAYS = ("=", "@", "\t", "\r")
SIGNS = ("+", "-")  # begin numbers as well: a formula that does harm calls a function or a program
CALL = re.compile(r"[A-Za-z_.]\s*\(|[|!]")


def is_formula(text: str) -> bool:
    """Whether a spreadsheet runs this cell: it begins as a formula does, and is not a number with its error."""
    return text.startswith(ALWAYS) or (text.startswith(SIGNS) and CALL.search(text) is not None)


def guarded(text: str) -> str:
    """The text as a cell that spreadsheets show and do not run; :func:`unguarded` gives the text back."""
    return f"'{text}" if is_formula(text.lstrip("'")) else text


def unguarded(cell: str) -> str:
    """The text of a cell that :func:`guarded` made; any other cell as it is."""
    return cell[1:] if cell.startswith("'") and is_formula(cell.lstrip("'")) else cell
