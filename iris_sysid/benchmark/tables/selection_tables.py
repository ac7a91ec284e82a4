"""Tables of equation selection from flat rows: accuracy of each method, and confusion matrices."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from iris_sysid.benchmark.sources.rows import OK, SELECTION
from iris_sysid.benchmark.sources.selection import wilson
from iris_sysid.benchmark.tables.table import Table, frame_table


def accuracy_table(rows: pd.DataFrame) -> Table:
    """Accuracy of each method in naming the class or equation, one line per data set and method.

    ``rows`` are flat rows; those of the study ``selection`` count. A failed row counts as wrong.
    """
    lines = [_accuracy(str(dataset), str(method), group) for (dataset, method), group in _groups(rows)]
    return frame_table(pd.DataFrame(lines), "Equation selection", notes=NOTES)


NOTES = (
    "95 % interval: Wilson, as if the videos were independent. No answer counts as wrong.",
    "A VLM or classifier names one of the classes; the bank names an equation, which is right when it is one of those "
    "that the class's phenomenon obeys. The two classes of pendulum pairs obey the same equation.",
)


def confusion_tables(rows: pd.DataFrame) -> Iterator[tuple[str, Table]]:
    """For each data set and method, its name and the table of true classes down and answers across."""
    for (dataset, method), group in _groups(rows):
        counts = pd.crosstab(group["phenomenon"], group["answer"])
        own = [name for name in counts.index if name in counts.columns]
        counts = counts[[*own, *(name for name in counts.columns if name not in own)]]
        right = group.groupby("phenomenon")["value"].sum() / group.groupby("phenomenon").size()
        counts["right (%)"] = [f"{100 * right[name]:.0f}" for name in counts.index]
        caption = f"{method} on {dataset or 'the clips'}: true class down, answer across"
        yield f"confusion {dataset} {method}", frame_table(counts.reset_index(names="true class"), caption)


def _groups(rows: pd.DataFrame) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    chosen = rows[rows["study"] == SELECTION]
    for (dataset, method), group in chosen.groupby(["dataset", "method"], sort=False):
        yield (str(dataset), str(method)), group


def _accuracy(dataset: str, method: str, group: pd.DataFrame) -> dict[str, object]:
    right, n = int(group["value"].sum()), len(group)
    low, high = wilson(right, n)
    return {
        "data": dataset,
        "method": method,
        "n": n,
        "right": right,
        "failed": int((group["status"] != OK).sum()),
        "accuracy (%)": f"{100 * right / n:.2f}",
        "95 % interval": f"{100 * low:.1f} to {100 * high:.1f}",
    }
