"""The program ``iris-sysid``, also as ``python -m iris_sysid``."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; answer Ctrl-C in one line, also while it is imported."""
    try:
        from iris_sysid.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        sys.stderr.write("iris-sysid: interrupted before anything began\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
