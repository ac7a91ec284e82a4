"""Derive the published benchmark numbers again: ``python -m validation.audit FOLDER -o OUTPUT``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from iris_sysid.errors import IrisError
from validation import pages
from validation.audit.reproduce import audit, verdicts
from validation.audit.write import NAMES, outcomes, write_audit


def main() -> None:
    """Write the audit of a folder of released files, and print the path of each page; exit with 1 when it fails."""
    parser = argparse.ArgumentParser(prog="python -m validation.audit", description=__doc__)
    parser.add_argument("folder", type=Path, help="the released result files, e.g. ../shared/data/iris_published")
    parser.add_argument("-o", "--output", type=Path, required=True, help=f"folder for {', '.join(NAMES)}")
    parser.add_argument("--force", action="store_true", help="replace the files of an earlier audit")
    pages.add_option(parser)
    arguments = parser.parse_args()
    try:
        written = write_audit(arguments.folder, arguments.output, overwrite=arguments.force)
    except IrisError as error:
        sys.exit(f"validation.audit: {error}")
    for path in written.values():
        print(path)
    if arguments.write_docs:
        with pages.table("audit", True):
            print(pages.markdown(outcomes(verdicts(audit(arguments.folder)))))


if __name__ == "__main__":
    main()
