"""``python -m iris_sysid``: the command line where the program ``iris-sysid`` is not on the path."""

from __future__ import annotations

from iris_sysid.cli import main

if __name__ == "__main__":
    main()
