"""The benchmark's tables for the docs, from the ``rows.csv`` that ``iris-sysid benchmark`` wrote."""

from __future__ import annotations

import argparse
from pathlib import Path

from iris_sysid.benchmark.sources.rows import read_rows
from iris_sysid.benchmark.tables.all_tables import tables_of
from iris_sysid.benchmark.tables.table import render
from validation import pages

# benchmark name -> docs name; the docs leave out the long tables (every reading, confusions, failures)
TABLES = {
    "headline": "benchmark-parameters",
    "selection": "benchmark-selection",
    "coupling": "benchmark-coupling",
    "sharing": "benchmark-sharing",
    "identifiability": "benchmark-identifiability",
    "extrapolation": "benchmark-extrapolation",
}


def main() -> None:
    """Print every table that the rows fill."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path, help="rows.csv")
    pages.add_option(parser)
    options = parser.parse_args()
    tables = tables_of(read_rows(options.rows))
    for name in (name for name in TABLES if name in tables):
        with pages.table(TABLES[name], options.write_docs):
            print(render(tables[name], "markdown"))


if __name__ == "__main__":
    main()
