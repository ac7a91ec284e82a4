"""Text as a reader of a page expects it: true minus, m/s², powers of ten, and symbols from LaTeX."""

from __future__ import annotations

import re
import unicodedata

from markupsafe import Markup, escape

from iris_sysid.types import Quantity

SUPERSCRIPTS = str.maketrans("0123456789-.", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻·")
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
MINUS = re.compile(r"(?<![\w.)°%/\-])-(?=\.?\d)")
DEGREES = re.compile(r"(?<=\d) °(?![/C])")
POWER = re.compile(r"(?<=[A-Za-z°])\^(-?\d+(?:\.\d+)?)")
EXPONENT = re.compile(r"(?<![\w.])(-?\d+(?:\.\d+)?)e([+-]\d+)(?!\w)")
MAX_ZEROS = 6  # 2e+06 is written out
GREEK_VARIANTS = {"varphi": "phi", "varepsilon": "epsilon", "vartheta": "theta"}
SUBSCRIPT = re.compile(r"_(?:\{([^{}]*)\}|(.))")


def typeset(text: str) -> str:
    """The text with a true minus, raised powers, powers of ten and degrees: ``-2.1e-05 m/s^2`` is −2.1·10⁻⁵ m/s²."""
    text = EXPONENT.sub(_written_out, text).replace(" +- ", " ± ")
    text = DEGREES.sub("°", text)
    return MINUS.sub("−", POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), text))


def _written_out(number: re.Match[str]) -> str:
    digits, power = number[1], int(number[2])
    if 0 <= power <= MAX_ZEROS:
        return f"{float(number[0]):.0f}"
    return f"{digits}·10{str(power).translate(SUPERSCRIPTS)}"


def symbol_html(latex: str) -> Markup:
    r"""A short LaTeX symbol as HTML: ``\theta_{1}`` is θ with a subscript 1; the rest is escaped."""
    html, end = Markup(""), 0
    for index in SUBSCRIPT.finditer(latex):
        html += escape(_letters(latex[end : index.start()])) + Markup("<sub>{}</sub>").format(
            _letters(index[1] if index[1] is not None else index[2])
        )
        end = index.end()
    return html + escape(_letters(latex[end:]))


def name_with_symbol(quantity: Quantity) -> str:
    """The name of a quantity with its symbol behind it, where that says more: theta θ."""
    symbol = SUBSCRIPT.sub(lambda index: (index[1] or index[2]).translate(SUBSCRIPTS), _letters(quantity.symbol))
    return quantity.name if symbol in ("", quantity.name) else f"{quantity.name} {symbol}"


def _letters(latex: str) -> str:
    """Greek letters by their names, and raised digits."""
    return POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), re.sub(r"\\([A-Za-z]+)\s*", _greek, latex))


def _greek(command: re.Match[str]) -> str:
    name = GREEK_VARIANTS.get(command[1], command[1])
    case = "CAPITAL" if name[0].isupper() else "SMALL"
    try:
        return unicodedata.lookup(f"GREEK {case} LETTER {name.upper()}")
    except KeyError:
        return command[1]
