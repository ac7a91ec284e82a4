"""From a clip to a pendulum's length with its error bar, and a report to look at.

The clip is rendered first, so that nothing has to be downloaded and the truth is known.
Run it: python examples/one_clip.py [folder]
"""

import sys
from pathlib import Path

from iris_sysid import estimates_frame, render_clip, run, save


def main(folder: Path) -> None:
    """Render, run the chain, print the estimates as a table and write the report."""
    clip = folder / "pendulum.mp4"
    render_clip("pendulum", clip, size=(640, 360), fps=60.0, duration_s=4.0, seed=1, overwrite=True)

    result = run(clip, "pendulum")

    print(estimates_frame(result.fit)[["value", "stderr", "unit"]])
    print(f"report: {save(result, folder / 'report', overwrite=True)}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "one-clip"))
