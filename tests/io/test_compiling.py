"""A first use says that it compiles, once; a later one, whose machine code was kept, says nothing."""

from numba import njit

import iris_sysid.io.kernels  # noqa: F401  # counts what numba compiles
from iris_sysid.io import compiling
from iris_sysid.io.compiling import CompileTime, when_compiling


def test_long_compiling_is_told_once():
    told, time = [], CompileTime()
    with when_compiling(lambda: told.append("first use")):
        time.add(0.4)
        assert not told
        time.add(0.7)
        time.add(5.0)
    assert told == ["first use"]


def test_nobody_is_told_after_the_block():
    told, time = [], CompileTime()
    with when_compiling(lambda: told.append("first use")):
        pass
    time.add(5.0)
    assert not told


def test_numba_compiling_is_counted_and_a_second_call_is_not(monkeypatch):
    monkeypatch.setattr(compiling, "NOTICED_S", 0.0)
    told = []
    function = njit(lambda x: x + 1.0)
    with when_compiling(lambda: told.append("compiled")):
        function(1.0)
    with when_compiling(lambda: told.append("again")):
        function(2.0)
    assert told == ["compiled"]
