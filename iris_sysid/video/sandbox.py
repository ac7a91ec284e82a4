"""Limits on memory and processor time for a process that reads files which are not trusted.

Decoders are large programs in C. One that a file makes crash, or take all memory or time, ends its process: here a
separate one, so that a command can say what happened, and a batch loses that clip alone.
"""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress

from iris_sysid.errors import IrisError

MAX_BYTES = 4 * 2**30  # a 4K clip takes 1 GB
MAX_CPU_S = 4 * 3600  # the longest clip of the published data set, 9000 frames at 4K, takes 2 h

_M_ARENA_MAX = -8  # of glibc's malloc.h
_LIMITED = "from iris_sysid.video.sandbox import limit_process; limit_process(); "


def limit_process(most_bytes: int = MAX_BYTES, most_cpu_s: float = MAX_CPU_S) -> None:
    """Limit this process from now on: beyond, memory is refused (MemoryError), and processor time ends the process.

    No file of the memory is written where it crashes; threads :func:`share_pools`. Without effect where the system
    knows no such limits.

    Parameters
    ----------
    most_bytes
        Memory that it may have at once, shared libraries and reserved addresses apart.
    most_cpu_s
        s, time of all its threads together from this call on. A second call begins anew.
    """
    try:
        import resource
    except ImportError:  # not a Unix
        return
    share_pools()
    used = resource.getrusage(resource.RUSAGE_SELF)
    wanted = {
        resource.RLIMIT_DATA: int(most_bytes),
        resource.RLIMIT_CPU: int(used.ru_utime + used.ru_stime + most_cpu_s) + 1,
        resource.RLIMIT_CORE: 0,
    }
    for limit, value in wanted.items():
        hard = resource.getrlimit(limit)[1]
        resource.setrlimit(limit, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))


def share_pools() -> None:
    """Make threads share two pools of memory from now on; without effect by another C library than glibc.

    With one each, as glibc has it, those of the decoders keep 30 MB more with every clip, and a 4K clip takes 100 to
    175 MB more.
    """
    with suppress(OSError, AttributeError, TypeError):  # another C library
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 2)


def run_limited(code: str, arguments: Sequence[str]) -> int:
    """Run Python code, whose ``sys.argv[1:]`` are the arguments, in a process with limits; return its exit status.

    IrisError when the process was ended by the system: it crashed, or took too much.
    """
    # -P: no module of the folder in which the command is given, whose files may be the untrusted ones
    ended = subprocess.run([sys.executable, "-P", "-c", _LIMITED + code, *arguments], check=False).returncode
    if ended < 0:
        raise IrisError(why_ended(-ended))
    return ended


def why_ended(number: int) -> str:
    """Why the system ended a process, from the number of the signal."""
    if number == getattr(signal, "SIGXCPU", None):
        return f"stopped after {MAX_CPU_S / 3600:g} h of processor time: is the file what it says?"
    name = signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
    return f"the process that reads the file crashed or was ended ({name}): is the file damaged, or memory full?"
