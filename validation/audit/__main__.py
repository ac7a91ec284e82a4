"""Derive the published benchmark numbers again: ``python -m validation.audit FOLDER -o OUTPUT``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from iris_sysid.errors import IrisError
from validation.audit.write import NAMES, write_audit


def main() -> None:
    """Write the audit of a folder of released files, and print the path of each page; exit with 1 when it fails."""
    parser = argparse.ArgumentParser(prog="python -m validation.audit", description=__doc__)
    parser.add_argument("folder", type=Path, help="the released result files, e.g. ../shared/data/iris_published")
    parser.add_argument("-o", "--output", type=Path, required=True, help=f"folder for {', '.join(NAMES)}")
    parser.add_argument("--force", action="store_true", help="replace the files of an earlier audit")
    arguments = parser.parse_args()
    try:
        written = write_audit(arguments.folder, arguments.output, overwrite=arguments.force)
    except IrisError as error:
        sys.exit(f"validation.audit: {error}")
    for path in written.values():
        print(path)


if __name__ == "__main__":
    main()
