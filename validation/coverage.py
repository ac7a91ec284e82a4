"""How often 95 % intervals contain the truth, and the scatter of estimates over the Cramer-Rao bound, by model."""

from __future__ import annotations

import argparse

import numpy as np

from iris_sysid.errors import IrisError
from tests._experiments import EXPERIMENTS, repeated
from validation import pages


def row(name: str, rho: float, seeds: int) -> str:
    """Repeat one experiment and format its row of the table."""
    try:
        errors, stderrs, hits, bound = repeated(name, rho, range(seeds))
    except (AssertionError, IrisError) as error:
        return f"| {name} | {rho:g} | failed: {str(error)[:80]} | | | |"
    covered, shares = 100 * hits.mean(), 100 * hits.mean(axis=0)
    lowest, highest = shares.min(), shares.max()
    pull = errors.std(axis=0) / stderrs.mean(axis=0)
    efficiency = f"{(errors.std(axis=0) / bound).max():.3f}" if rho == 0 else "-"
    return f"| {name} | {rho:g} | {covered:.1f} | {lowest:.1f}-{highest:.1f} | {pull.mean():.3f} | {efficiency} |"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=400, help="experiments for each model and noise")
    parser.add_argument("--models", nargs="*", default=list(EXPERIMENTS), help="names of models")
    parser.add_argument("--rho", nargs="*", type=float, default=[0.0, 0.9], help="correlation from sample to sample")
    pages.add_option(parser)
    arguments = parser.parse_args()
    with pages.table("coverage", arguments.write_docs):
        print(f"{arguments.seeds} experiments for each row")
        print(
            "| model | rho | covered / % | each value / % | scatter / standard error | scatter / "
            "Cramer-Rao, worst value |"
        )
        print("|---|---|---|---|---|---|")
        for name in arguments.models:
            for rho in arguments.rho:
                print(row(name, rho, arguments.seeds), flush=True)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
