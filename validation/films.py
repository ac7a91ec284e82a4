"""The filmed recordings that several programs measure: the command of each, from the raw file to a trajectory."""

from __future__ import annotations

import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

DATA = Path("..") / "shared" / "data"
FLIGHT = "--fps 240 --scale gravity=9.79 --mark launch=5,103"


@dataclass(frozen=True, slots=True)
class Film:
    """A recording: its file below the folder of data, its phenomenon, and the other options of ``run``."""

    name: str
    file: str
    phenomenon: str
    options: str

    @property
    def command(self) -> str:
        """The command without the place of its output."""
        return f"run {DATA / self.file} --phenomenon {self.phenomenon} {self.options}"


FILMS = (
    Film("iris-pendulum", "iris_footage/pendulum.gif", "pendulum", "--set ball_radius=33.5+-1mm"),
    Film("juangomez", "juangomez_pendulum/pendulum.mp4", "pendulum", "--scale 640px=1m"),
    Film("projectile-30", "phystrack/Projectile_Motion__30Deg_2_726mps.MP4", "projectile", FLIGHT),
    Film("projectile-60", "phystrack/Projectile_Motion__60Deg_2_699mps.MP4", "projectile", FLIGHT),
    Film("sliding-friction-R1", "phystrack/SlidingFriction_R1.MP4", "sliding-cone", "--fps 240 --scale 440px=1m"),
    Film("sliding-friction-R3", "phystrack/SlidingFriction_R3.MP4", "sliding-cone", "--fps 240 --scale 440px=1m"),
)


def named(name: str) -> Film:
    """The recording of that name."""
    return next(film for film in FILMS if film.name == name)


def run(film: Film, folder: Path) -> None:
    """Write what ``run`` measures into a folder; a misfit is no failure here, as the diagnosis examines it."""
    program = Path(sys.executable).parent / "iris-sysid"
    words = [str(program), *shlex.split(film.command), "-o", str(folder), "--force"]
    subprocess.run(words, capture_output=True, check=False)
