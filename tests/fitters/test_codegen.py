"""Functions made from source text: only what is meant, and only with names that have a value."""

import numpy as np
import pytest

from fitters.integrator.codegen import generated, row


def test_function_is_made_with_the_values_given():
    made = generated(f"def twice(x):\n    return factor * {row('x', 1)}[0]\n", {"factor": 2.0})
    assert made((3.0,)) == 6.0


def test_row_lists_items_from_the_first_wanted():
    assert row("params", 2, first=3) == "(params[3], params[4], )"
    assert row("state", 1, ", c") == "(state[0, c], )"
    assert row("state", 0) == "()"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("import os", "must be one function"),
        ("def f(x):\n    return x\nx = 1", "must be one function"),
        ("def f(x):\n    import os\n    return x", "must not hold a Import"),
        ("def f(x):\n    return x.__class__", "must not use .__class__"),
        ("def f(x):\n    return open(x)", "uses open, which has no value"),
        ("def f(x):\n    return [y for y in x]", "must not hold a ListComp"),
        ("def f(x):\n    return (lambda: x)()", "must not hold a Lambda"),
        ("def f(__x):\n    return __x", "cannot name anything"),
    ],
)
def test_source_that_holds_anything_else_is_refused(source, message):
    with pytest.raises(ValueError, match=message):
        generated(source, {})


def test_value_whose_name_is_no_name_is_refused():
    with pytest.raises(ValueError, match="'a b' cannot name anything"):
        generated("def f(x):\n    return x", {"a b": np.sin})
