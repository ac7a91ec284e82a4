"""The program ``iris-sysid``, also as ``python -m iris_sysid``."""

from __future__ import annotations

import gc
import sys

# between two searches for cycles: those of the start, every 700 objects as is usual, take a sixth of a second
MORE_OBJECTS = 50_000


def main() -> None:
    """Run the command line; answer Ctrl-C in one line, also while it is imported."""
    gc.set_threshold(MORE_OBJECTS)
    try:
        from iris_sysid.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        sys.stderr.write("iris-sysid: interrupted before anything began\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
