"""Machine code of right-hand sides, kept in the user's private cache: compiled once, not in every process.

A function is known by its fingerprint: its bytecode and constants, those of every function that it calls, and the
values that it takes from around it. Together with the versions of Python, numba, LLVM, numpy and this package, and
with the processor, it is the name under which the machine code is kept. A function that uses anything that has no
fingerprint (an object, another module) is compiled in memory.
"""

from __future__ import annotations

import functools
import hashlib
import json
import sys
import types as python_types
from collections.abc import Callable
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from numba import cfunc
from numba.core import config
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.types import WrapperAddressProtocol

from fitters.integrator.dormand_prince import COLUMNS_SIGNATURE
from iris_sysid._version import __version__
from iris_sysid.io.private_cache import cache_directory, read_private, write_private

FORMAT = "iris-sysid machine code 3"
MODULES = ("math", "numpy")  # whose functions a version number identifies
PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis))


class NoFingerprintError(Exception):
    """A function uses an object without a fingerprint that is the same in every process."""


class NativeColumns(WrapperAddressProtocol):
    """Machine code that numba calls by its address.

    Parameters
    ----------
    engine
        Holds the code, from :func:`engine_with`; it lives as long as this.
    symbol
        Name of the function in it.
    """

    def __init__(self, engine: llvm.ExecutionEngine, symbol: str) -> None:
        self._engine = engine
        self._engine.finalize_object()
        self._address = int(self._engine.get_function_address(symbol))
        if not self._address:
            raise ValueError(f"the machine code has no {symbol}")

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        """The one signature that all these functions have."""
        return COLUMNS_SIGNATURE


def engine_with(source: str) -> llvm.ExecutionEngine:
    """An engine with code in LLVM's intermediate form, for this processor; empty: none yet."""
    target = llvm.Target.from_default_triple().create_target_machine(jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(source), target)


class LoadedFunction(NativeColumns):
    """Machine code loaded from the cache."""

    def __init__(self, code: bytes, symbol: str) -> None:
        engine = engine_with("")
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        super().__init__(engine, symbol)


def compiled_columns(function: Callable[..., Any], *, catches: bool = False) -> Any:
    """The function as machine code that kernels can call, from the cache where it has been compiled before.

    Parameters
    ----------
    function
        ``(t, states (s, c), params (p, c), inputs (m,), out)``, all float64; what it calls may be Python functions
        that numba compiles.
    catches
        Whether the function catches every exception; what can raise one is not kept.

    Raises
    ------
    NumbaError
        When numba cannot compile it.
    """
    name = _name_of(function)
    kept = None if name is None else _loaded(name)
    if kept is not None:
        return kept
    made = cfunc(COLUMNS_SIGNATURE, error_model="numpy")(function)
    if name is not None and (catches or not _holds_exceptions(made)):
        _keep(name, made)
    return made


def can_raise(columns: Any) -> bool:
    """Whether machine code can raise an exception: it then holds what would be unpickled to make one.

    Code out of the cache cannot, because what can is not kept there unless it catches its exceptions; nor can a chain
    of such code.
    """
    return not isinstance(columns, NativeColumns) and _holds_exceptions(columns)


def _holds_exceptions(made: Any) -> bool:
    return ".const.picklebuf" in made._library.get_llvm_str()


def _loaded(name: str) -> LoadedFunction | None:
    content = read_private(name)
    if content is None:
        return None
    head, _, code = content.partition(b"\n")
    try:
        entry = json.loads(head)
        whole = entry["format"] == FORMAT and entry["sha256"] == hashlib.sha256(code).hexdigest()
        return LoadedFunction(code, str(entry["symbol"])) if whole else None
    except (ValueError, KeyError, TypeError, RuntimeError):
        return None  # damaged: compiled anew, and replaced


def _keep(name: str, made: Any) -> None:
    """Write the object code of a compiled function to the cache, unless it holds addresses of this process."""
    library = made._library
    if library.has_dynamic_globals or getattr(library, "_reload_init", ()):
        return
    _, _, (code, _) = library.serialize_using_object_code()
    head = {"format": FORMAT, "symbol": made.native_name, "sha256": hashlib.sha256(code).hexdigest()}
    write_private(name, json.dumps(head).encode() + b"\n" + code)


def _name_of(function: Callable[..., Any]) -> str | None:
    """Name of a function's entry; None where it has no fingerprint, or the cache is off."""
    if cache_directory() is None:
        return None
    try:
        content = repr((_circumstances(), _fingerprint(function, {})))
    except NoFingerprintError:
        return None
    return hashlib.sha256(content.encode()).hexdigest()


@functools.cache
def _circumstances() -> tuple[Any, ...]:
    """Everything except the function on which its machine code depends."""
    cpu_target.target_context.refresh()  # what machine code calls must be there before any is loaded
    return (
        FORMAT,
        __version__,
        sys.version,
        numba.__version__,
        llvmlite.__version__,
        llvm.llvm_version_info,
        np.__version__,
        cpu_target.target_context.codegen().magic_tuple(),
        tuple((name, getattr(config, name, None)) for name in ("OPT", "BOUNDSCHECK", "LOOP_VECTORIZE", "USING_SVML")),
    )


def _fingerprint(value: Any, seen: dict[int, int]) -> tuple[Any, ...]:  # noqa: C901 - one line a kind of value
    """Fingerprint of a value, the same in every process; ``seen`` are the enclosing functions, by identity."""
    if isinstance(value, PLAIN):
        return type(value).__name__, repr(value)
    if isinstance(value, tuple):
        return "tuple", *(_fingerprint(item, seen) for item in value)
    if isinstance(value, frozenset):
        return "frozenset", *sorted(repr(_fingerprint(item, seen)) for item in value)
    if isinstance(value, np.ufunc):
        return "ufunc", value.__name__
    if isinstance(value, np.generic | np.ndarray):
        if value.dtype.hasobject:
            raise NoFingerprintError
        return "array", str(value.dtype), value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    if isinstance(value, python_types.ModuleType) and value.__name__.partition(".")[0] in MODULES:
        return "module", value.__name__
    if isinstance(value, python_types.BuiltinFunctionType) and value.__module__ in (*MODULES, "builtins"):
        return "builtin", value.__module__, value.__qualname__
    if isinstance(value, type) and value.__module__ in ("builtins", "numpy"):
        return "type", value.__module__, value.__qualname__
    if isinstance(value, Dispatcher):
        return "compiled", repr(sorted(value.targetoptions.items())), _fingerprint(value.py_func, seen)
    if isinstance(value, python_types.FunctionType):
        return _fingerprint_of_function(value, seen)
    raise NoFingerprintError


def _fingerprint_of_function(function: python_types.FunctionType, seen: dict[int, int]) -> tuple[Any, ...]:
    if id(function) in seen:
        return "seen", seen[id(function)]
    seen[id(function)] = len(seen)
    names = sorted(_names_in(function.__code__) & function.__globals__.keys())
    around = [(name, _fingerprint(function.__globals__[name], seen)) for name in names if name != "__builtins__"]
    cells = [_fingerprint(cell.cell_contents, seen) for cell in function.__closure__ or ()]
    defaults = _fingerprint(function.__defaults__ or (), seen)
    return "function", _fingerprint_of_code(function.__code__, seen), tuple(around), tuple(cells), defaults


def _fingerprint_of_code(code: python_types.CodeType, seen: dict[int, int]) -> tuple[Any, ...]:
    constants = [
        _fingerprint_of_code(item, seen) if isinstance(item, python_types.CodeType) else _fingerprint(item, seen)
        for item in code.co_consts
    ]
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    return code.co_code.hex(), tuple(constants), names, code.co_argcount, code.co_kwonlyargcount, code.co_flags


def _names_in(code: python_types.CodeType) -> set[str]:
    inner = (item for item in code.co_consts if isinstance(item, python_types.CodeType))
    return set(code.co_names).union(*(_names_in(item) for item in inner))
