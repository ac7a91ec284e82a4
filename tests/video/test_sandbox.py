"""A process with limits: what takes too much ends alone, and says so; results are the same."""

import subprocess
import sys

import pytest

from iris_sysid.errors import IrisError
from iris_sysid.video.sandbox import run_limited

LIMIT = "from iris_sysid.video.sandbox import limit_process; limit_process(most_bytes={bytes}, most_cpu_s={cpu_s}); "


def _limited(code, bytes=2**30, cpu_s=60):
    command = [sys.executable, "-c", LIMIT.format(bytes=bytes, cpu_s=cpu_s) + code]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)


def test_memory_beyond_the_limit_is_refused():
    assert "MemoryError" in _limited("b'x' * 2**30").stderr
    assert _limited("print(len(b'x' * 2**28))").stdout == f"{2**28}\n"


def test_time_beyond_the_limit_ends_the_process():
    ended = _limited("print('began', flush=True)\nwhile True: pass", cpu_s=0)
    assert ended.stdout == "began\n"
    assert -ended.returncode == 24  # SIGXCPU


def test_exit_status_and_arguments_pass_through():
    assert run_limited("import sys; sys.exit(len(sys.argv[1:]))", ["--force", "a b"]) == 2


@pytest.mark.parametrize(("name", "match"), [("SIGSEGV", "SIGSEGV"), ("SIGXCPU", "processor time")])
def test_crash_is_a_stated_failure(name, match):
    with pytest.raises(IrisError, match=match):
        run_limited(f"import os, signal; os.kill(os.getpid(), signal.{name})", [])


def _command(*arguments):
    program = [sys.executable, "-c", "from iris_sysid.cli import main; main()"]
    return subprocess.run([*program, *map(str, arguments)], check=False, capture_output=True, text=True, timeout=120)


def test_command_in_a_sandbox_writes_the_same_bytes(pendulum_clip, tmp_path):
    plain, limited = tmp_path / "plain.png", tmp_path / "limited.png"
    first = _command("frame", pendulum_clip, "--time", "0.5", "-o", plain)
    second = _command("frame", pendulum_clip, "--time", "0.5", "-o", limited, "--sandbox")
    assert (first.returncode, second.returncode) == (0, 0)
    assert second.stdout == first.stdout.replace(str(plain), str(limited))
    assert limited.read_bytes() == plain.read_bytes()


def test_command_whose_process_dies_in_the_sandbox_ends_with_one_line(tmp_path, angles):
    (tmp_path / "crash.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n")
    done = _command("fit", angles, "--model", f"{tmp_path / 'crash.py'}:m", "-o", tmp_path / "f.json", "--sandbox")
    assert done.returncode == 1
    assert done.stderr.startswith("iris-sysid: the process that reads the file crashed or was ended (SIGSEGV)")
    assert "Traceback" not in done.stderr
