"""Small valid files for every target, made by the library itself, and the words that their formats consist of."""

from __future__ import annotations

import hashlib
import io
import json
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import av
import cv2
import numpy as np

from iris_sysid.calibration.calibration_json import write_calibration
from iris_sysid.calibration.pixel_scale import scale_from_text
from iris_sysid.io.csv_read import read_trajectory, side_car_of
from iris_sysid.io.csv_write import write_trajectory
from iris_sysid.trajectory.smoothing import smooth

FOUND = Path(__file__).parent / "corpus"  # inputs that broke a reader once: TARGET-what
IMAGE = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
CLIPS = {
    "mp4": "libx264",
    "avi": "mpeg4",
    "webm": "libvpx",
    "ts": "libx264",
    "ogg": "libvpx",
    "flv": "libx264",
    "gif": "gif",
}
TRK = """<?xml version="1.0" encoding="UTF-8"?><object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
<property name="videoclip" type="object"><object class="x.VideoClip"><property name="video" type="object"><object
class="x.Video"><property name="path" type="string">clip.avi</property></object></property><property
name="startframe" type="int">1</property><property name="stepsize" type="int">2</property><property name="frameshift"
type="int">3</property></object></property><property name="clipcontrol" type="object"><object class="x"><property
name="delta_t" type="double">33.3</property></object></property><property name="coords" type="object"><object
class="x"><property name="framedata" type="array"><property name="[0]" type="object"><object class="x"><property
name="xorigin" type="double">3</property><property name="yorigin" type="double">3</property><property name="angle"
type="double">0</property><property name="xscale" type="double">100</property><property name="yscale"
type="double">100</property></object></property></property></object></property><property name="length_unit"
type="string">m</property><property name="tracks" type="collection"><property name="item" type="object"><object
class="x.PointMass"><property name="name" type="string">m</property><property name="framedata" type="array"><property
name="[4]" type="object"><object class="x"><property name="x" type="double">1</property><property name="y"
type="double">2</property></object></property></property></object></property></property></object>"""

NUMBERS = "-1 0 1e19 1e308 1e999 nan inf 1e-400 0x1 1_0 ² ٣ 1,5 -0 9999999999999999999999999"
JSON_WORDS = '" {} [] null true [[ {"a":1} "version":1, "document":"fit", \\ud800'
TABLE_WORDS = ', ; " t_s x_px y_px body valid segment sigma_theta_rad d_theta_rad_s smooth_theta_rad cov_ u_V # sep=;'
SPACES = (b"\t", b"\n", b"\r", b"\0", b" ", "\ufeff".encode(), b"Zeit (s)")
OPTION_WORDS = "= +- ± px m mm deg % gamma @ , : plumb= pivot= x ( ) [ ] 1/ gravity .py:"
EQUATION_WORDS = "' '' = ; sin( max( , ^ ** / ( ) t u1 pi theta __ lambda -"
XML_WORDS = '<!ENTITY &#0; <object> </object> PointMass [999999999] framedata encoding="utf-7"'
ZIP_WORDS = (b"PK\x01\x02", b"PK\x03\x04", b"PK\x05\x06", b"\x08\0", b"\x0c\0", b"\x0e\0", b"\0\x08", b"\xff" * 4)
BINARY_WORDS = (
    *(b"\0" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x80\0\0\0", b"\0\0\0\1", b"\xff\xd8", b"\xff\xda"),
    *b"IHDR IDAT tRNS moov trak stts stsz elst tkhd mdat OggS RIFF G@".split(),
)


def _encoded(*lists: str) -> tuple[bytes, ...]:
    return tuple(word.encode() for words in lists for word in words.split())


WORDS: Mapping[str, tuple[bytes, ...]] = {
    "csv": (*_encoded(NUMBERS, TABLE_WORDS), *SPACES),
    "documents": _encoded(NUMBERS, JSON_WORDS),
    "side-car": _encoded(NUMBERS, JSON_WORDS),
    "osp-tracker": _encoded(NUMBERS, XML_WORDS),
    "excel": ZIP_WORDS,
    "archive": ZIP_WORDS,
    "option": _encoded(NUMBERS, OPTION_WORDS),
    "equation": _encoded(NUMBERS, EQUATION_WORDS),
}


def words_of(target: str) -> tuple[bytes, ...]:
    """Pieces that a mutation may insert: what the format consists of, and numbers at the edge."""
    return WORDS.get(target, BINARY_WORDS)


def corpus_of(target: str) -> list[bytes]:
    """Valid inputs of a target, and those that broke it once."""
    return [*SEEDS[target](), *(path.read_bytes() for path in sorted(FOUND.glob(f"{target}-*")))]


# --------------------------------------------------------------------------- seeds


def _tables() -> list[bytes]:
    rows = "".join(f"{k / 10},{0.1 * np.cos(k):.4f},0.001\n" for k in range(8))
    track = "".join(f"{k},{k / 30},1,{k + 0.5},3,0.1,0.1,1\n" for k in range(8))
    return [
        f"t_s,theta_rad,sigma_theta_rad\n{rows}".encode(),
        f"frame,t_s,body,x_px,y_px,sigma_x_px,sigma_y_px,valid\n{track}".encode(),
        "# made elsewhere\nZeit (s);Winkel (°)\n0,0;1,5\n0,1;1,4\n0,2;1,0\n".encode("cp1252"),
        "t\tx\n(s)\t(cm)\n0\t1\n1\t2\n2\t3\n".encode("utf-16"),
    ]


def _in_folder(make: Callable[[Path], Path]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return make(Path(folder)).read_bytes()


def _side_car(folder: Path) -> Path:
    rows = "".join(f"{k / 10},{0.1 * np.cos(k):.4f}\n" for k in range(20))
    (folder / "a.csv").write_text(f"t_s,theta_rad\n{rows}")
    return side_car_of(write_trajectory(smooth(read_trajectory(folder / "a.csv")), folder / "b.csv"))


def _calibration(folder: Path) -> Path:
    return write_calibration(scale_from_text("640+-3px=1m"), folder / "calibration.json")


def _fit(folder: Path) -> Path:
    from fitters.ode import fit
    from iris_sysid.io.json_documents import write_fit

    t_s = np.arange(40) / 20
    rows = "".join(f"{t:.3f},{0.2 * np.cos(4 * t):.6f}\n" for t in t_s)
    (folder / "a.csv").write_text(f"t_s,theta_rad\n{rows}")
    trajectory = read_trajectory(folder / "a.csv")
    return write_fit(fit(trajectory, "linear-pendulum"), trajectory, folder / "fit.json")


def _documents() -> list[bytes]:
    return [_in_folder(_calibration), _in_folder(_side_car), _in_folder(_fit)]


def _clip(suffix: str) -> bytes:
    buffer = io.BytesIO()
    kind = {"ts": "mpegts"}.get(suffix, suffix)
    with av.open(buffer, "w", format=kind) as container:
        stream = container.add_stream(CLIPS[suffix], rate=25)
        stream.width, stream.height = 64, 48
        stream.pix_fmt = "rgb8" if suffix == "gif" else "yuv420p"
        for k in range(4):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.roll(IMAGE, 3 * k, axis=1), format="rgb24")))
        container.mux(stream.encode(None))
    return buffer.getvalue()


def _picture(suffix: str) -> list[bytes]:
    small = IMAGE[:, :, 0], IMAGE[:8, :8]
    return [cv2.imencode(suffix, np.ascontiguousarray(image))[1].tobytes() for image in (IMAGE, *small)]


def _zipped(members: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def _archives() -> list[bytes]:
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    packed = {"project.trk": TRK.encode(), "clip.avi": _clip("avi")}
    pictures = {f"a/{k}.png": _picture(".png")[1] for k in range(2)}
    return [*(_zipped(packed, method) for method in methods), _zipped(pictures)]


def _workbook() -> list[bytes]:
    schemas = "http://schemas.openxmlformats.org"
    main, office = f"{schemas}/spreadsheetml/2006/main", f"{schemas}/officeDocument/2006/relationships"

    def related(kind: str, to: str) -> str:
        inside = f'<Relationship Id="r1" Type="{office}/{kind}" Target="{to}"/>'
        return f'<Relationships xmlns="{schemas}/package/2006/relationships">{inside}</Relationships>'

    def row(number: int, *cells: str) -> str:
        inside = "".join(f'<c r="{"AB"[k]}{number}" {cell}</c>' for k, cell in enumerate(cells))
        return f'<row r="{number}">{inside}</row>'

    titles = [f't="inlineStr"><is><t>{title}</t></is>' for title in ("t (s)", "x (m)")]
    rows = row(1, *titles) + "".join(row(k + 2, f"><v>{k}</v>", "><v>1</v>") for k in range(4))
    sheets = '<sheets><sheet name="S" sheetId="1" r:id="r1"/></sheets>'
    parts = {
        "_rels/.rels": related("officeDocument", "xl/workbook.xml"),
        "xl/_rels/workbook.xml.rels": related("worksheet", "worksheets/sheet1.xml"),
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}">{sheets}</workbook>',
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{main}"><sheetData>{rows}</sheetData></worksheet>',
    }
    return [_zipped({name: text.encode() for name, text in parts.items()}, zipfile.ZIP_STORED)]


def _code() -> list[bytes]:
    """An entry whose last byte was changed."""
    code = b"\x7fELF" + bytes(200)
    head = {"format": "iris-sysid machine code 2", "symbol": "f", "sha256": hashlib.sha256(code).hexdigest()}
    return [json.dumps(head).encode() + b"\n" + code[:-1] + b"\1"]


OPTIONS = """gravity=9.79+-0.01m/s^2|640+-3px=1m|10,20,300,200|pivot=437,42|1=120,88@35|plumb=1,2,3,4|1280x720|9x6
25.0+-0.1mm|quadratic-drag=0.08|272.2,446.1,273.2,47.4=1m|L=0.1:10|gamma=2.2+-5%|d_theta_rad_s|398.7(5)px=100cm
t=Zeit (s),theta[deg]=Winkel"""
EQUATIONS = (
    "theta'' = -g/L*sin(theta) - c*theta'",
    "h' = -k*sqrt(max(h, 0))",
    "x''=-a*x+b*y; y''=-a*y^3/(1+exp(x))*u1",
)

SEEDS: Mapping[str, Callable[[], list[bytes]]] = {
    "csv": _tables,
    "excel": _workbook,
    "documents": _documents,
    "side-car": lambda: [_in_folder(_side_car)],
    "osp-tracker": lambda: [TRK.encode()],
    "archive": _archives,
    "png": lambda: _picture(".png"),
    "jpeg": lambda: _picture(".jpg"),
    "tiff": lambda: _picture(".tiff"),
    "video": lambda: [_clip(suffix) for suffix in CLIPS],
    "option": lambda: [text.encode() for text in OPTIONS.replace("\n", "|").split("|")],
    "equation": lambda: [text.encode() for text in EQUATIONS],
    "machine-code": _code,
}
