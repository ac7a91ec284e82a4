"""What the tests of the command line share: tiny clips and tables, made once, and the command line itself."""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pytest

from iris_sysid import cli as command_line
from iris_sysid.synthetic import render_clip
from tests._drawn import disc, noisy, paint
from tests._motions import pendulum_angle

SHAPE = (96, 128)
WALL = np.full(SHAPE, 80.0)


@dataclass(frozen=True)
class Outcome:
    """What a command did: its exit status, and what it wrote to stdout and stderr."""

    status: int
    out: str
    err: str


@pytest.fixture
def cli(monkeypatch, capfd) -> Callable[..., Outcome]:
    """Run a command in this process: ``cli("fit", table, "--model", "pendulum")``."""

    def call(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["iris-sysid", *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as exit_info:
            command_line.main()
        out, err = capfd.readouterr()
        return Outcome(int(exit_info.value.code or 0), out, err)

    return call


@pytest.fixture
def nothing_written(tmp_path):
    """Check after the test that the temporary folder holds what it held when :func:`seen` was called."""
    before = {}

    def seen() -> None:
        before.update(listing(tmp_path))

    yield seen
    assert listing(tmp_path) == before


def listing(folder: Path) -> dict[str, bytes | None]:
    """Every file below a folder with its bytes, and every folder with None."""
    contents = {}
    for base, folders, files in os.walk(folder):
        contents |= {str((Path(base) / name).relative_to(folder)): None for name in folders}
        contents |= {str((Path(base) / name).relative_to(folder)): (Path(base) / name).read_bytes() for name in files}
    return contents


def write_video(path: Path, images: list[np.ndarray], rate: int = 30) -> Path:
    """Encode grey images (h, w) as lossless H.264."""
    height, width = images[0].shape
    grey = np.full((height // 2, width), 128, np.uint8)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.vstack([image, grey]), format="yuv420p")))
        container.mux(stream.encode())
    return path


def discs(*positions: tuple[float, float]) -> np.ndarray:
    """A bright disc of 5 px radius at each position, on a grey wall."""
    image = WALL
    for x, y in positions:
        image = paint(image, disc(SHAPE, x, y, 5.0), 180.0)
    return image


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Path:
    """The folder of what is made once; tests only read it."""
    return tmp_path_factory.mktemp("made")


@pytest.fixture(scope="session")
def pendulum_clip(made) -> Path:
    """Three seconds of a pendulum of 0.5 m, 160 x 90 px, with its truth beside it."""
    clip = made / "pendulum.mp4"
    render_clip("pendulum", clip, size=(160, 90), fps=30.0, duration_s=3.0, seed=1)
    return clip


@pytest.fixture(scope="session")
def still_clip(made) -> Path:
    """Noise, and nothing that moves."""
    return write_video(made / "still.mp4", noisy([WALL] * 30, 3.0))


@pytest.fixture(scope="session")
def leaving_clip(made) -> Path:
    """A disc that comes in on the left and has left on the right after a third of the clip."""
    return write_video(made / "leaving.mp4", noisy([discs((-10.0 + 7.0 * k, 40.0)) for k in range(60)], 3.0))


@pytest.fixture(scope="session")
def two_movers_clip(made) -> Path:
    """Two discs alike that swing alike, one above the other."""
    across = 64.0 + 30.0 * np.cos(2 * np.pi * np.arange(60) / 30)
    return write_video(made / "two.mp4", noisy([discs((x, 28.0), (x, 68.0)) for x in across], 3.0))


@pytest.fixture(scope="session")
def one_frame_clip(made) -> Path:
    """A clip of a single frame."""
    return write_video(made / "one.mp4", noisy([discs((64.0, 48.0))], 3.0))


@pytest.fixture(scope="session")
def text_clip(made) -> Path:
    """A text file that is called a video."""
    path = made / "text.mp4"
    path.write_text("this is no video\n")
    return path


@pytest.fixture(scope="session")
def cut_clip(made, pendulum_clip) -> Path:
    """The first half of a video file."""
    path = made / "cut.mp4"
    path.write_bytes(pendulum_clip.read_bytes()[: pendulum_clip.stat().st_size // 2])
    return path


@pytest.fixture(scope="session")
def angles(made) -> Path:
    """A table of a pendulum's angles, typed by hand as it were: 1 m, damped, with noise and a gap."""
    t_s = np.arange(0.0, 8.0, 0.04)
    theta_rad = pendulum_angle(t_s, 0.6, length_m=1.0, damping=0.05)
    theta_rad = theta_rad + np.random.default_rng(3).normal(0.0, 0.002, t_s.size)
    theta_rad[90:95] = np.nan
    path = made / "angles.csv"
    pd.DataFrame({"t_s": t_s, "theta_rad": theta_rad}).to_csv(path, index=False)
    return path
