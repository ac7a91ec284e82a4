"""Arithmetic expressions in text: read by recursive descent, and written out as LaTeX or for the code generator.

The text is never evaluated: what is not a number, a name, one of the functions here or arithmetic is refused, with the
column at which it stands.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types import symbol_of

MAX_CHARACTERS, MAX_DEPTH, MAX_OPERATIONS = 1000, 30, 150  # characters of a text, brackets in brackets, operations
MAX_NAME = 40
TIME, INPUT_NAME, DELAYED = "t", re.compile(r"u[0-9]*"), "delayed"
CONSTANTS = {"pi": np.pi}
FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "exp": np.exp, "log": np.log, "sqrt": np.sqrt, "abs": np.abs,
    "sign": np.sign, "tanh": np.tanh, "atan": np.arctan, "max": np.maximum, "min": np.minimum,
}  # fmt: skip
OF_TWO = ("max", "min")
POWER: Callable[..., float] = np.power
ALIKE = str.maketrans({"′": "'", "’": "'", "″": '"', "−": "-", "·": "*", "×": "*"})
TOKEN = re.compile(r"\s*(?:([0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?)|(\w+)('*)|(\*\*|.))")
PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "negative": 2, "^": 4}


class ExpressionError(DataError):
    """A text that is not an expression; the message names the column and the sign there."""

    def __init__(self, text: str, column: int, reason: str) -> None:
        there = "".join(letter if letter.isprintable() else "?" for letter in text[column : column + 20])
        shown = f"at {there}" if there.strip() else "at its end"
        super().__init__(f"cannot read the equation, column {column + 1} ({shown}): {reason}")


@dataclass(frozen=True, slots=True)
class Expression:
    """A number (``value``), a name (``head``), or an operation ``head`` on ``parts``; ``column`` is where it stands.

    The name of a derivative ends with as many ``'`` as its order. ``DELAYED`` has an input and its delay as parts.
    """

    head: str
    parts: tuple[Expression, ...] = ()
    value: float | None = None
    column: int = 0

    def names(self) -> Iterator[Expression]:
        """The names in it, from left to right."""
        if not self.parts and self.value is None:
            yield self
        for part in self.parts:
            yield from part.names()

    def calls(self) -> Iterator[Expression]:
        """The functions called in it."""
        if self.head in FUNCTIONS:
            yield self
        for part in self.parts:
            yield from part.calls()

    def delayed(self) -> Iterator[tuple[Expression, Expression]]:
        """The delayed inputs in it, each with its delay: a name or a number."""
        if self.head == DELAYED:
            yield self.parts[0], self.parts[1]
        for part in self.parts:
            yield from part.delayed()

    def source(self, names: Mapping[str, str]) -> str:
        """Its text for the code generator; ``names`` says how each name is written there, an input's as it acts."""
        if self.value is not None:
            return repr(self.value)
        if not self.parts:
            return names[self.head]
        if self.head == DELAYED:
            return names[self.parts[0].head]
        parts = [part.source(names) for part in self.parts]
        if self.head == "negative":
            return f"(-{parts[0]})"
        if self.head == "^":
            whole = self.parts[1].value
            if whole is not None and whole in (2.0, 3.0, 4.0):
                return f"({parts[0]} ** {whole:.0f})"
            return f"power({parts[0]}, {parts[1]})"
        return f"{self.head}({', '.join(parts)})" if self.head in FUNCTIONS else f"({self.head.join(parts)})"

    def latex(self, symbols: Mapping[str, str]) -> str:
        """Its LaTeX; ``symbols`` says how each name is written there."""
        if self.value is not None:
            return f"{self.value:g}"
        if not self.parts:
            return symbols[self.head]
        first, last = self.parts[0], self.parts[-1]
        if self.head == DELAYED:
            return rf"{first.latex(symbols)}\left({symbols[TIME]} - {last.latex(symbols)}\right)"
        if self.head == "/":
            return rf"\frac{{{first.latex(symbols)}}}{{{last.latex(symbols)}}}"
        if self.head in ("sqrt", "abs"):
            inside = first.latex(symbols)
            return rf"\sqrt{{{inside}}}" if self.head == "sqrt" else rf"\left|{inside}\right|"
        if self.head in FUNCTIONS:
            known = self.head if self.head != "sign" else "mathrm{sign}"
            return rf"\{known}\left({', '.join(part.latex(symbols) for part in self.parts)}\right)"
        mine = PRECEDENCE[self.head]
        if self.head == "negative":
            return f"-{last._bracketed(symbols, mine + 1)}"
        if self.head == "^":
            return f"{first._bracketed(symbols, mine + 1)}^{{{last.latex(symbols)}}}"
        left, right = first._bracketed(symbols, mine), last._bracketed(symbols, mine + (self.head != "+"))
        return rf"{left}\,{right}" if self.head == "*" else f"{left} {self.head} {right}"

    def _bracketed(self, symbols: Mapping[str, str], least: int) -> str:
        text = self.latex(symbols)
        binds = PRECEDENCE.get(self.head, 9) if self.parts and self.head != "/" else 9
        return text if binds >= least else rf"\left({text}\right)"


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str  # number, name, sign or end
    text: str
    column: int


def symbol(name: str) -> str:
    """LaTeX of a name: a Greek letter where it is one, what follows ``_`` or a number as an index."""
    head, _, index = name.partition("_")
    return f"{symbol_of(head)}_{{{index}}}" if index else symbol_of(head)


def read_equations(text: str) -> list[tuple[Expression, Expression]]:
    """Read equations, ``left = right``, separated by ``;``.

    Raises
    ------
    ExpressionError
        With the column at which it cannot be read.
    """
    if len(text) > MAX_CHARACTERS:
        raise ExpressionError(text, MAX_CHARACTERS, f"the text is longer than {MAX_CHARACTERS} characters")
    return _Reader(text, list(_tokens(text.translate(ALIKE).replace('"', "''"), text)), of_time=True).equations()


def read_expression(text: str) -> Expression:
    """Read one expression; ExpressionError as for :func:`read_equations`."""
    if len(text) > MAX_CHARACTERS:
        raise ExpressionError(text, MAX_CHARACTERS, f"the text is longer than {MAX_CHARACTERS} characters")
    reader = _Reader(text, list(_tokens(text.translate(ALIKE), text)))
    made = reader.sum()
    if reader.now.kind != "end":
        raise reader.fail(reader.unexpected())
    return made


def _tokens(readable: str, text: str) -> Iterator[_Token]:
    column = 0
    while match := TOKEN.match(readable, column):
        number, name, primes, sign = match.groups()
        at = match.start(match.lastindex or 0) if not primes else match.start(2)
        column = match.end()
        if number:
            if not np.isfinite(float(number)) or len(number) > MAX_NAME:
                raise ExpressionError(text, at, "the number is too large")
            yield _Token("number", number, at)
        elif name:
            _check_name(name, text, match.start(2))
            yield _Token("name", name + primes, match.start(2))
        elif sign.strip():
            yield _Token("sign", sign, at)
    yield _Token("end", "the end", len(readable.rstrip()))


def _check_name(name: str, text: str, column: int) -> None:
    if name[0].isdigit():
        raise ExpressionError(text, column, f"{name:.20} is neither a number nor a name; write * between factors")
    if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_") or "__" in name:
        raise ExpressionError(text, column, f"{name:.40} cannot name anything here; use letters, digits and _")
    if len(name) > MAX_NAME:
        raise ExpressionError(text, column, f"the name is longer than {MAX_NAME} letters")


class _Reader:
    """Recursive descent: equation, sum, product, sign, power, item."""

    def __init__(self, text: str, tokens: Sequence[_Token], of_time: bool = False) -> None:
        self.text, self.tokens, self.of_time = text, tokens, of_time
        self.at = self.depth = self.operations = 0

    @property
    def now(self) -> _Token:
        return self.tokens[self.at]

    def fail(self, reason: str, token: _Token | None = None) -> ExpressionError:
        return ExpressionError(self.text, (token or self.now).column, reason)

    def take(self, *signs: str) -> _Token | None:
        """The present token, if it is one of these signs, and move on."""
        if self.now.kind != "sign" or self.now.text not in signs:
            return None
        self.at += 1
        return self.tokens[self.at - 1]

    def equations(self) -> list[tuple[Expression, Expression]]:
        found = []
        while self.now.kind != "end":
            left = self.item()
            if not self.take("="):
                raise self.fail("an equation is written as theta'' = ..., with = after its left side")
            self.operations = 0
            found.append((left, self.sum()))
            if not self.take(";") and self.now.kind != "end":
                raise self.fail(self.unexpected())
        if not found:
            raise self.fail("there is no equation; write it as theta'' = -g/L*sin(theta)")
        return found

    def unexpected(self) -> str:
        if self.now.kind in ("name", "number") or self.now.text == "(":
            return f"an operator is missing before {self.now.text}; write * between factors"
        return f"{self.now.text} is not expected here"

    def operation(self, head: str, token: _Token, *parts: Expression) -> Expression:
        self.operations += 1
        if self.operations > MAX_OPERATIONS:
            raise self.fail(f"the equation has more than {MAX_OPERATIONS} operations", token)
        return Expression(head, parts, None, token.column)

    def sum(self) -> Expression:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fail(f"more than {MAX_DEPTH} brackets or powers stand inside one another")
        made = self.product()
        while token := self.take("+", "-"):
            made = self.operation(token.text, token, made, self.product())
        self.depth -= 1
        return made

    def product(self) -> Expression:
        made = self.signed()
        while token := self.take("*", "/"):
            made = self.operation(token.text, token, made, self.signed())
        return made

    def signed(self) -> Expression:
        signs = []
        while token := self.take("+", "-"):
            signs.append(token)
        made = self.power()
        for token in reversed(signs):
            made = self.operation("negative", token, made) if token.text == "-" else made
        return made

    def power(self) -> Expression:
        base = self.item()
        token = self.take("^", "**")
        if token is None:
            return base
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fail(f"more than {MAX_DEPTH} brackets or powers stand inside one another")
        made = self.operation("^", token, base, self.signed())
        self.depth -= 1
        return made

    def item(self) -> Expression:
        token = self.now
        if self.take("("):
            made = self.sum()
            self.close(token)
            return made
        if token.kind == "number":
            self.at += 1
            return Expression("", (), float(token.text), token.column)
        if token.kind != "name":
            raise self.fail("a number, a name or ( is expected here, not " + token.text)
        self.at += 1
        if self.now.text == "(" and self.now.kind == "sign":
            return self.call(token)
        if token.text in FUNCTIONS:
            raise self.fail(f"{token.text} is a function: write {token.text}(...)", token)
        value = CONSTANTS.get(token.text)
        return Expression("" if value is not None else token.text, (), value, token.column)

    def input_at(self, name: _Token) -> Expression:
        """An input now, ``u(t)``, or earlier, ``u(t - tau)``."""
        opened, given = self.now, Expression(name.text, (), None, name.column)
        self.at += 1
        if self.now.text != TIME:
            raise self.fail(f"{name.text} is an input: write {name.text}, or {name.text}(t - tau) for a delayed one")
        self.at += 1
        if self.take("-"):
            delay = self.item()
            if delay.parts or delay.head == TIME or INPUT_NAME.fullmatch(delay.head):
                raise self.fail("a delay is one number or one name, as tau", name)
            given = self.operation(DELAYED, name, given, delay)
        self.close(opened)
        return given

    def call(self, name: _Token) -> Expression:
        if INPUT_NAME.fullmatch(name.text) and self.of_time:
            return self.input_at(name)
        if name.text not in FUNCTIONS:
            known = ", ".join(FUNCTIONS)
            raise self.fail(f"there is no function {name.text}; there are {known}. A product needs *", name)
        opened = self.now
        self.at += 1
        parts = [self.sum()]
        while self.take(","):
            parts.append(self.sum())
        self.close(opened)
        needed = 2 if name.text in OF_TWO else 1
        if len(parts) != needed:
            raise self.fail(f"{name.text} takes {needed} argument{'s' * (needed > 1)}, not {len(parts)}", name)
        return self.operation(name.text, name, *parts)

    def close(self, opened: _Token) -> None:
        if not self.take(")"):
            missing = self.now.kind == "end" or self.now.text == ";"
            raise self.fail("this bracket is not closed", opened) if missing else self.fail(self.unexpected())
