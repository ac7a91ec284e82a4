"""Machine code of one right-hand side after another: a few instructions that call what is compiled already.

They are written in LLVM's intermediate form: numba takes ten times as long to compile two calls, and a search makes
such a pair for every set of effects.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core.registry import cpu_target

from fitters.integrator.dormand_prince import COLUMNS_SIGNATURE
from fitters.integrator.machine_code import NativeColumns, engine_with

NAME = "chained"
DATA, SHAPE = 4, 5  # of numba's arrays, where their first number and their lengths are


class ChainedColumns(NativeColumns):
    """Machine code that calls that of a base, then that of a step.

    Parameters
    ----------
    base, step
        Compiled, with the signature of all right-hand sides: neither may raise.
    first
        How many of the parameters the base takes; the step takes those after them.
    """

    def __init__(self, base: Any, step: Any, first: int) -> None:
        self._parts = base, step  # own the code that is called
        super().__init__(engine_with(_source(_address(base), _address(step), first)), NAME)


def _address(columns: Any) -> int:
    """Where compiled code begins: of numba, of the cache, or of a chain."""
    known = columns.__wrapper_address__() if isinstance(columns, NativeColumns) else columns.address
    return int(known)


def _source(base: int, step: int, first: int) -> str:
    """The function ``columns(t, states, params, inputs, out)`` in LLVM's intermediate form, from two addresses."""
    kinds = [cpu_target.target_context.get_value_type(kind) for kind in COLUMNS_SIGNATURE.args]
    kind, number = ir.FunctionType(ir.VoidType(), kinds), ir.IntType(64)
    module = ir.Module()
    function = ir.Function(module, kind, NAME)
    code = ir.IRBuilder(function.append_basic_block())
    t, states, params, inputs, out = function.args
    count = ir.Constant(number, first)
    rows, width = (code.extract_value(params, [SHAPE, axis]) for axis in (0, 1))
    start = code.gep(code.extract_value(params, DATA), [code.mul(count, width)])
    after = code.insert_value(params, start, DATA)
    after = code.insert_value(after, code.sub(rows, count), [SHAPE, 0])
    for address, taken in ((base, params), (step, after)):
        code.call(code.inttoptr(ir.Constant(number, address), kind.as_pointer()), (t, states, taken, inputs, out))
    code.ret_void()
    return str(module)
