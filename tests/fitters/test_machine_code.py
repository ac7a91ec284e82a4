"""Machine code of right-hand sides is kept between processes, and only where nobody else can have written it."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from fitters.integrator import machine_code
from fitters.integrator.chained_code import ChainedColumns
from fitters.integrator.codegen import generated
from fitters.integrator.dormand_prince import slopes_along
from fitters.integrator.machine_code import LoadedFunction, compiled_columns
from fitters.ode import simulate
from iris_sysid.io.private_cache import cache_directory, read_private, write_private
from iris_sysid.registry import MODELS

NAME = "0" * 64
FACTOR = 2.0


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A private cache of this test alone."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("IRIS_SYSID_CACHE", str(folder))
    return folder


def slope(t, state, params):
    return (-FACTOR * params[0] * state[0],)


def columns(rhs=slope):
    source = (
        "def columns(t, states, params, inputs, out):\n"
        "    for c in range(states.shape[1]):\n"
        "        (out[0, c], ) = rhs(t, (states[0, c], ), (params[0, c], ))\n"
    )
    from numba import njit

    return generated(source, {"rhs": njit(rhs)})


def test_function_is_compiled_once_and_loaded_after(cache):
    compiled_columns(columns())
    assert len(list(cache.iterdir())) == 1
    assert isinstance(compiled_columns(columns()), LoadedFunction)


def test_function_that_uses_another_value_is_another_function(cache, monkeypatch):
    compiled_columns(columns())
    monkeypatch.setitem(globals(), "FACTOR", 3.0)
    assert not isinstance(compiled_columns(columns()), LoadedFunction)
    assert len(list(cache.iterdir())) == 2


def test_function_that_uses_what_cannot_be_distinguished_is_not_kept(cache, monkeypatch):
    monkeypatch.setitem(globals(), "FACTOR", dataclasses.make_dataclass("Thing", ["x"])(1.0))
    assert machine_code._name_of(columns()) is None


def test_other_versions_have_other_names(cache, monkeypatch):
    before = machine_code._name_of(columns())
    monkeypatch.setattr(machine_code, "_circumstances", lambda: ("another numba",))
    assert machine_code._name_of(columns()) != before


def test_damaged_file_is_compiled_anew_and_replaced(cache):
    compiled_columns(columns())
    (file,) = cache.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:-10])
    assert not isinstance(compiled_columns(columns()), LoadedFunction)
    assert isinstance(compiled_columns(columns()), LoadedFunction)


@pytest.mark.parametrize("name", ["pendulum", "bouncing-ball"])
def test_loaded_machine_code_gives_the_same_numbers(cache, name):
    script = (
        "import sys; import numpy as np; from fitters.ode import simulate; from iris_sysid.registry import MODELS\n"
        f"m = MODELS[{name!r}]; v = dict(m.example.values)\n"
        "sys.stdout.buffer.write(simulate(m, m.example.t_s, v).states.tobytes())"
    )
    model = MODELS[name]
    here = simulate(model, model.example.t_s, dict(model.example.values)).states
    runs = [subprocess.run([sys.executable, "-c", script], capture_output=True, check=True).stdout for _ in range(2)]
    assert len(list(cache.iterdir())) == (3 if model.events else 1)
    assert runs[0] == runs[1] == np.ascontiguousarray(here).tobytes()


def test_two_processes_at_once_both_succeed(cache):
    script = (
        "import sys\nfrom iris_sysid.io.private_cache import read_private, write_private\n"
        f"name, content = {NAME!r}, b'x' * 99999\n"
        "done = [write_private(name, content) and read_private(name) == content for _ in range(50)]\n"
        "sys.exit(not all(done))"
    )
    runs = [subprocess.Popen([sys.executable, "-c", script]) for _ in range(2)]
    assert [run.wait() for run in runs] == [0, 0]
    assert [file.name for file in cache.iterdir()] == [NAME]


# --------------------------------------------------------------------------- the private directory


def test_content_is_read_back(cache):
    assert write_private(NAME, b"machine code")
    assert read_private(NAME) == b"machine code"
    assert cache.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o777])
def test_directory_that_others_can_enter_is_not_used(cache, mode):
    assert write_private(NAME, b"machine code")
    cache.chmod(mode)
    assert read_private(NAME) is None
    assert not write_private(NAME, b"other")


def test_link_to_a_directory_is_not_followed(cache, tmp_path):
    assert write_private(NAME, b"machine code")
    cache.rename(tmp_path / "real")
    cache.symlink_to(tmp_path / "real")
    assert read_private(NAME) is None
    assert not write_private(NAME, b"other")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a directory away")
def test_directory_of_another_user_is_not_used(cache):
    assert write_private(NAME, b"machine code")
    os.chown(cache, 12345, 12345)
    assert read_private(NAME) is None


def test_unwritable_directory_means_compilation_in_memory(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("IRIS_SYSID_CACHE", str(tmp_path / "file" / "cache"))
    assert not write_private(NAME, b"machine code")
    assert not isinstance(compiled_columns(columns()), LoadedFunction)


@pytest.mark.parametrize("value", ["off", "0", "OFF"])
def test_cache_can_be_switched_off(monkeypatch, value):
    monkeypatch.setenv("IRIS_SYSID_CACHE", value)
    assert cache_directory() is None
    assert not write_private(NAME, b"machine code")


@pytest.mark.parametrize("name", ["../../etc/passwd", "a", "G" * 64])
def test_names_that_are_no_digest_are_refused(cache, name):
    assert not write_private(name, b"machine code")
    assert read_private(name) is None


def test_oldest_files_go_when_there_are_too_many(cache, monkeypatch):
    monkeypatch.setattr("iris_sysid.io.private_cache.MAX_FILES", 8)
    for k in range(9):
        assert write_private(f"{k:064x}", b"x")
        os.utime(cache / f"{k:064x}", (k, k))
    assert write_private(f"{9:064x}", b"x")
    kept = {int(file.name, 16) for file in cache.iterdir()}
    assert 0 not in kept
    assert 9 in kept


def add_second(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        out[0, c] += t * params[0, c]


def test_chain_gives_each_step_the_parameters_after_those_of_the_base():
    base, step = compiled_columns(columns()), compiled_columns(add_second)
    chain = ChainedColumns(ChainedColumns(base, step, 1), step, 2)
    states, params = np.array([[1.0, 2.0]]), np.array([[1.0, 2.0], [10.0, 20.0], [100.0, 200.0]])
    slopes = np.zeros((2, 1, 2))
    arguments = np.array([0.0, 2.0]), np.repeat(states[None], 2, axis=0), params, np.zeros((2, 0)), slopes
    slopes_along(chain, *arguments)
    assert slopes[0].tolist() == [[-2.0, -8.0]]
    assert slopes[1].tolist() == [[-2.0 + 220.0, -8.0 + 440.0]]
