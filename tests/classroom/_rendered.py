"""A class of rendered pendulum clips, five of them with a fault."""

from fractions import Fraction

import av
import numpy as np

from iris_sysid import render_clip
from iris_sysid.synthetic.look import Look

SIZE, RATE_HZ, SLOWED = (480, 270), 60.0, 4
FAULTS = {
    "group-03": "scale",
    "group-05": "wrong-body",
    "group-07": "tilt",
    "group-10": "constant",
    "group-12": "clock",
}


def render_class(folder, count, seed=0):
    """Clips ``group-01.mp4`` to that of ``count``, and ``groups.csv`` with the scale of each."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["group,scale,set"]
    for k in range(1, count + 1):
        name, fault = f"group-{k:02d}", FAULTS.get(f"group-{k:02d}")
        ppm = _render(folder / f"{name}.mp4", fault, rng, seed + k)
        stated = ppm * (1 + 0.01 * rng.standard_normal()) / (1.6 if fault == "scale" else 1.0)
        lines.append(f"{name},{stated:.1f}px=1m,{'gravity=1.62' if fault == 'constant' else ''}")
    (folder / "groups.csv").write_text("\n".join(lines) + "\n")


def _render(path, fault, rng, seed):
    """Render one clip; returns its px in a metre."""
    look = Look(roll_deg=8.0 if fault == "tilt" else 0.7 * rng.standard_normal())
    if fault == "wrong-body":
        truth = render_clip("dropping-ball", path, size=SIZE, fps=RATE_HZ, seed=seed, overrides={"height": 0.8})
        return truth.camera["pixels_per_metre"]
    rate, seconds = (SLOWED * RATE_HZ, 3.0) if fault == "clock" else (RATE_HZ, 4.0)
    values = {
        "length": 0.5 * (1 + 0.004 * rng.standard_normal()),
        "theta_0": -rng.uniform(0.25, 0.5),
        "damping": rng.uniform(0.03, 0.09),
    }
    plain = path.with_suffix(".mkv") if fault == "clock" else path
    truth = render_clip(
        "pendulum", plain, size=SIZE, fps=rate, duration_s=seconds, seed=seed, overrides=values, look=look
    )
    if fault == "clock":
        _slowed(plain, path, SLOWED)
        plain.unlink()
    return truth.camera["pixels_per_metre"]


def _slowed(source, target, factor):
    """The same images at a rate that is ``factor`` times lower, as a phone writes slow motion."""
    with av.open(str(source)) as played, av.open(str(target), "w") as written:
        stream = played.streams.video[0]
        coded = written.add_stream("libx264", rate=Fraction(stream.average_rate) / factor)
        coded.width, coded.height, coded.pix_fmt, coded.options = stream.width, stream.height, "yuv420p", {"crf": "15"}
        for frame in played.decode(stream):
            image = av.VideoFrame.from_ndarray(frame.to_ndarray(format="bgr24"), format="bgr24")
            written.mux(coded.encode(image))
        written.mux(coded.encode())
