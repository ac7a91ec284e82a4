"""Progress on a terminal: the phases are named, and something moves in each, also while nothing is counted."""

import os
import pty
import subprocess
import sys
import time
from itertools import pairwise

from iris_sysid.cli import _terminal

SILENT_WORK = """
import time
from iris_sysid.cli import _terminal
with _terminal.progress("tracking", then="fitting") as report:
    report(27, 55)
    time.sleep(1.2)
    report(55, 55)
    time.sleep(1.2)
"""


def on_terminal(code: str) -> list[tuple[float, bytes]]:
    """What a program writes to a terminal that is its stderr, with the times in s."""
    ours, its = pty.openpty()
    done = subprocess.Popen([sys.executable, "-c", code], stderr=its, env={**os.environ, "TERM": "xterm"})
    os.close(its)
    written = []
    while True:
        try:
            text = os.read(ours, 65536)
        except OSError:  # the other end is closed
            break
        if not text:
            break
        written.append((time.monotonic(), text))
    os.close(ours)
    assert done.wait() == 0
    return written


def test_something_moves_while_nothing_is_counted_and_the_next_phase_is_named():
    written = on_terminal(SILENT_WORK)
    times = [at for at, _ in written]
    assert max(after - before for before, after in pairwise(times)) < 2.0
    text = b"".join(part for _, part in written).decode()
    assert "27/55" in text
    assert "0/55" not in text
    bars = {shown.partition("0:0")[0] for shown in text.split("fitting")[1:]}
    assert len(bars) > 2  # it moves
    assert text.index("tracking") < text.index("fitting")


def test_nothing_is_shown_where_stderr_is_no_terminal(capsys):
    with _terminal.phases("fitting") as say:
        say("refitting")
    with _terminal.progress("tracking") as report:
        report(1, 2)
    assert capsys.readouterr() == ("", "")
