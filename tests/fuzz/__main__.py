"""Look for input that breaks a reader: ``python -m tests.fuzz --seconds 3600 [--target csv] [--engine hypothesis]``.

Each target runs in a separate process, so that a crash or a hang of one is a line of the table; atheris guides the
search by the lines reached where it is installed. Exit status 1 where anything but an IrisError came out.
"""

from __future__ import annotations

import argparse
import faulthandler
import re
import subprocess
import sys
from pathlib import Path

from tests.fuzz.engines import fuzz_by_atheris, fuzz_by_hypothesis, has_atheris

ENGINES = ("atheris", "hypothesis")
GRACE_S = 120.0  # beyond the time asked for: imports, the seeds, an input that takes its time
INPUTS = re.compile(r"^(?:stat::number_of_executed_units: +|Done |inputs: )([0-9]+)", re.MULTILINE)


def main() -> int:
    """Fuzz the targets that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of all targets together")
    parser.add_argument("--target", action="append", help="one of the readers; all of them if none is given")
    parser.add_argument("--engine", choices=ENGINES, default=ENGINES[0] if has_atheris() else ENGINES[1])
    parser.add_argument("--kept", type=Path, default=Path("fuzz-output"), help="folder for what breaks a target")
    parser.add_argument("--here", action="store_true", help="in this process: one target")
    options = parser.parse_args()
    if options.here:  # nothing is imported yet: atheris watches what is imported under its eyes
        return in_this_process(options.target[0], options.engine, options.seconds, options.kept)
    from tests.fuzz.targets import FUZZ_TARGETS

    targets = options.target or list(FUZZ_TARGETS)
    if unknown := set(targets) - set(FUZZ_TARGETS):
        parser.error(f"there is no reader {', '.join(unknown)}; there are {', '.join(FUZZ_TARGETS)}")
    print(f"target | inputs ({options.engine}) | came out\n--- | ---: | ---")
    broken = 0
    for target in targets:
        inputs, outcome = in_a_process(target, options.engine, options.seconds / len(targets), options.kept)
        print(f"{target} | {inputs} | {outcome.splitlines()[0]}", flush=True)
        broken += outcome != "results and stated errors"
        sys.stderr.write("" if outcome == "results and stated errors" else outcome + "\n")
    return 1 if broken else 0


def in_this_process(target: str, engine: str, seconds: float, kept: Path) -> int:
    """Run one target; an exception of it ends the process."""
    if engine == "atheris":
        fuzz_by_atheris(target, seconds, kept)
    else:
        faulthandler.dump_traceback_later(seconds + GRACE_S / 2)  # where it hangs
        print(f"inputs: {fuzz_by_hypothesis(target, seconds)}")
    return 0


def in_a_process(target: str, engine: str, seconds: float, kept: Path) -> tuple[int, str]:
    """The number of inputs that a target was given, and what came out of it."""
    command = [sys.executable, "-m", "tests.fuzz", "--here", "--target", target, "--engine", engine]
    command += ["--seconds", str(seconds), "--kept", str(kept)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=seconds + GRACE_S)
    except subprocess.TimeoutExpired as hang:
        said = (hang.stderr or b"").decode(errors="replace")
        return 0, f"a hang: no end {GRACE_S:.0f} s after the time\n{said[-3000:]}"
    counted = INPUTS.findall(done.stdout + done.stderr)
    inputs = int(counted[-1]) if counted else 0
    if done.returncode < 0:
        return inputs, f"a crash: signal {-done.returncode}\n{done.stderr[-3000:]}"
    if done.returncode:
        return inputs, f"an error that is not ours:\n{done.stderr[-3000:]}"
    return inputs, "results and stated errors"


if __name__ == "__main__":
    sys.exit(main())
