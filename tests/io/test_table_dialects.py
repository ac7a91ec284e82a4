"""Tables as people have them: the same swing, written in the ways of many programs, is read as the same swing."""

import io
import time
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from scipy.io import savemat

from iris_sysid import Quantity, read_trajectory
from iris_sysid.errors import DataError
from iris_sysid.io.table_headers import columns_for, parse_columns

LONG = 100_000
T_S = np.round(np.arange(12) * 0.04, 2)
THETA = np.round(0.35 * np.cos(4.4 * T_S), 6)
X_M, Z_M = np.round(0.5 * np.sin(THETA), 6), np.round(-0.5 * np.cos(THETA), 6)
DEG = np.round(np.degrees(THETA), 6)


def rows(*columns, separator=",", comma=False, beside=""):
    """Lines of numbers, with decimal commas if asked for, and text in a last column."""
    lines = [separator.join(f"{value:.6f}" for value in row) for row in zip(*columns, strict=True)]
    lines = [line.replace(".", ",") if comma else line for line in lines]
    return "\n".join(line + (f"{separator}{beside}" if beside else "") for line in lines) + "\n"


ANGLES = {
    "own": ("t_s,theta_rad\n" + rows(T_S, THETA), None),
    "own, degrees": ("t_s,theta_deg\n" + rows(T_S, DEG), None),
    "brackets": ("time [s],theta [rad]\n" + rows(T_S, THETA), None),
    "parentheses": ("Time (s),Angle (deg)\n" + rows(T_S, DEG), None),
    "no unit of time": ("t,theta_rad\n" + rows(T_S, THETA), None),
    "milliseconds": ("t_ms,theta_rad\n" + rows(1000 * T_S, THETA), None),
    "spelled": ("Time in seconds,angle in degrees\n" + rows(T_S, DEG), None),
    "slash": ("t / s,theta / rad\n" + rows(T_S, THETA), None),
    "German": ("Zeit (s);Winkel (°)\n" + rows(T_S, DEG, separator=";", comma=True), None),
    "German, points": ("Zeit (s);Winkel (°)\n" + rows(T_S, DEG, separator=";"), None),
    "German, cp1252": (("Zeit (s);Winkel (°)\n" + rows(T_S, DEG, separator=";", comma=True)).encode("cp1252"), None),
    "Portuguese": ("Tempo_ms,Angulo_graus\n" + rows(1000 * T_S, DEG), None),
    "French, tabs": ("temps (s)\tangle (°)\n" + rows(T_S, DEG, separator="\t", comma=True), None),
    "byte order mark": (b"\xef\xbb\xbf" + ("time (s),theta (rad)\n" + rows(T_S, THETA)).encode(), None),
    "UTF-16": (("time (s),theta (rad)\n" + rows(T_S, THETA)).encode("utf-16"), None),
    "carriage returns": (("time (s),theta (rad)\r\n" + rows(T_S, THETA).replace("\n", "\r\n")).encode(), None),
    "Excel's sep line": ("sep=;\ntime (s);theta (rad)\n" + rows(T_S, THETA, separator=";"), None),
    "comments": ("# pendulum, run 3\n# by me\ntime (s),theta (rad)\n" + rows(T_S, THETA), None),
    "commented header": ("// run\n// time (s)\ttheta (rad)\n" + rows(T_S, THETA, separator="\t"), None),
    "per cent comment": ("% made by a script\ntime (s),theta (rad)\n" + rows(T_S, THETA), None),
    "row of units": ("time,theta\ns,rad\n" + rows(T_S, THETA), None),
    "two header rows": ("Run 1,Run 1\ntime (s),theta (rad)\n" + rows(T_S, THETA), None),
    "Logger Pro": ("Latest: Time (s),Latest: Angle (deg)\n" + rows(T_S, DEG), None),
    "Capstone": ("Time (s) Run #1,Angle (rad) Run #1\n" + rows(T_S, THETA), None),
    "text beside": ("time (s),theta (rad),note\n" + rows(T_S, THETA, beside="fine"), None),
    "spaces": ("t_[s]   theta_[rad]\n" + rows(T_S, THETA, separator="   "), None),
    "trailing comma": ("time (s),theta (rad),\n" + rows(T_S, THETA).replace("\n", ",\n"), None),
    "quoted": ('"time (s)","theta (rad)"\n' + rows(T_S, THETA), None),
    "index": (",time (s),theta (rad)\n" + rows(np.arange(12), T_S, THETA), None),
    "no header": (rows(T_S, THETA), "t=1,theta[rad]=2"),
    "stated by title": ("Zeit;Ausschlag\n" + rows(T_S, DEG, separator=";", comma=True), "t=Zeit,theta[deg]=Ausschlag"),
    "stated, commas in titles": ("a,b\n" + rows(T_S, DEG), "t[s]=a, theta[deg]=b"),
    "frames": ("frame,theta (rad)\n" + rows(np.arange(12), THETA), "t[0.04 s]=frame,theta=theta (rad)"),
    "frames a second": ("frame,theta (rad)\n" + rows(np.arange(12), THETA), "t[1/25 s]=frame,theta=theta"),
    "rows": ("theta\n" + rows(THETA), "t[0.04 s]=row,theta[rad]=theta"),
    "logger": ("theta (°),Time (ms),Voltage (V)\n" + rows(DEG, 1000 * T_S, THETA), "t=Time (ms),theta=theta (°)"),
}
PATHS = {
    "Tracker": ("mass A\t\t\nt\tx\ty\n" + rows(T_S, X_M, Z_M, separator="\t"), "t=t,x[m]=x,z[m]=y"),
    "metres, y up": ("t (s),x (m),y (m)\n" + rows(T_S, X_M, Z_M), None),
    "Kinovea": ("#Kinovea Trajectory data export\n#T X Y\n" + rows(T_S, X_M, Z_M, separator=" "), "t=1,x[m]=2,z[m]=3"),
    "phyphox": ('"Time (s)","x (cm)","z (cm)"\n' + rows(T_S, 100 * X_M, 100 * Z_M), None),
    "trackpy": (
        "y,x,mass,size,frame,particle\n"
        + rows(-1000 * Z_M, 1000 * X_M, 0 * T_S + 50, 0 * T_S + 2, np.arange(12), 0 * T_S),
        "t[1/25 s]=frame,x[0.001 m]=x,z[-0.001 m]=y",
    ),
    "DeepLabCut": (
        "scorer,net,net,net\nbodyparts,bob,bob,bob\ncoords,x,y,likelihood\n"
        + rows(np.arange(12), 1000 * X_M, -1000 * Z_M, 0 * T_S + 1),
        "t[1/25 s]=1,x[0.001 m]=bob/x,z[-0.001 m]=bob/y",
    ),
}


def read(tmp_path, content, columns):
    path = tmp_path / "table.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_trajectory(path, columns and parse_columns(columns))


@pytest.mark.parametrize("dialect", ANGLES)
def test_angle_is_read_from_the_table_of_any_program(tmp_path, dialect):
    content, columns = ANGLES[dialect]
    trajectory = read(tmp_path, content, columns)
    assert trajectory.quantities[0].column == "theta_rad"
    np.testing.assert_allclose(trajectory.t_s, T_S, atol=1e-9)
    np.testing.assert_allclose(trajectory.position[:, 0], THETA, atol=1e-6)
    if not dialect.startswith("own"):
        assert any("theta = column" in text for text in trajectory.origin["read_as"])


@pytest.mark.parametrize("dialect", PATHS)
def test_path_is_read_from_the_table_of_any_program(tmp_path, dialect):
    content, columns = PATHS[dialect]
    trajectory = read(tmp_path, content, columns)
    assert [quantity.column for quantity in trajectory.quantities] == ["x_m", "z_m"]
    np.testing.assert_allclose(trajectory.t_s, T_S, atol=1e-9)
    np.testing.assert_allclose(trajectory.position, np.column_stack([X_M, Z_M]), atol=1e-6)


@pytest.mark.parametrize(
    ("content", "columns", "message"),
    [
        (
            "time,theta\n" + rows(T_S, THETA),
            None,
            r"no column states .* e\.g\. columns=\{'t': 'time', 'theta\[rad\]': 'theta'\}",
        ),
        ("t,x,y\n" + rows(T_S, X_M, Z_M), None, r"no column states a position.*'x', 'y'"),
        ("a (m),b (m)\n" + rows(T_S, THETA), None, "no column t_s, nor one that is called a time"),
        ("time (s),x (m),x (cm)\n" + rows(T_S, X_M, X_M), "x=x", "more than one column 'x'"),
        ("time (s),x\n" + rows(T_S, X_M), "x=x", r"'x' has no unit; state it as x\[unit\]=x"),
        ("time (s),x\n" + rows(T_S, X_M), "x[furlong]=x", "no unit 'furlong'"),
        ("time (s),x\n" + rows(T_S, X_M), "x[m]=height", "no column 'height'; its columns are 'time"),
        ("time (s),x\n" + rows(T_S, X_M), "x[m]", "cannot read 'x"),
        ("time (s),x\n" + rows(T_S, X_M), "t[m]=x,x[m]=x", "state it as t"),
        (
            "time (s),x\n" + rows(T_S, X_M),
            "t=time",
            r"no column states a position.* columns=\{'t': 'time",
        ),
        ("time (s),x (m)\n" + rows(np.tile(T_S, 2), np.tile(X_M, 2)), None, "several runs below each other"),
        ("nothing\nof\nnumbers\n", None, "holds no rows of numbers"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", None, "is not a table: it holds NUL bytes"),
        (b"PK\x03\x04 not a zip", None, "cannot be read as an Excel file"),
        (b"\xd0\xcf\x11\xe0 not a book", None, "cannot be read as an Excel file"),
    ],
)
def test_table_that_does_not_say_what_it_holds_is_refused_with_the_option_that_does(
    tmp_path, content, columns, message
):
    with pytest.raises(DataError, match=message):
        read(tmp_path, content, columns)


def workbook(**sheets):
    """The bytes of an Excel file with cells of text and numbers, made without any library."""
    names = list(sheets)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as book:
        kind = "application/vnd.openxmlformats-officedocument.spreadsheetml"
        parts = "".join(
            f'<Override PartName="/xl/worksheets/sheet{k}.xml" ContentType="{kind}.worksheet+xml"/>'
            for k in range(1, len(names) + 1)
        )
        book.writestr(
            "[Content_Types].xml",
            '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
            '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            f'<Override PartName="/xl/workbook.xml" ContentType="{kind}.sheet.main+xml"/>{parts}</Types>',
        )
        relation = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
        package = "http://schemas.openxmlformats.org/package/2006/relationships"
        main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
        book.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{package}"><Relationship Id="r1" Type="{relation}/officeDocument" '
            'Target="xl/workbook.xml"/></Relationships>',
        )
        listed = "".join(f'<sheet name="{name}" sheetId="{k}" r:id="r{k}"/>' for k, name in enumerate(names, start=1))
        book.writestr(
            "xl/workbook.xml", f'<workbook xmlns="{main}" xmlns:r="{relation}"><sheets>{listed}</sheets></workbook>'
        )
        links = "".join(
            f'<Relationship Id="r{k}" Type="{relation}/worksheet" Target="worksheets/sheet{k}.xml"/>'
            for k in range(1, len(names) + 1)
        )
        book.writestr("xl/_rels/workbook.xml.rels", f'<Relationships xmlns="{package}">{links}</Relationships>')
        for k, table in enumerate(sheets.values(), start=1):
            lines = "".join(f"<row>{''.join(map(cell, line))}</row>" for line in table)
            book.writestr(
                f"xl/worksheets/sheet{k}.xml", f'<worksheet xmlns="{main}"><sheetData>{lines}</sheetData></worksheet>'
            )
    return out.getvalue()


def cell(value):
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
    return f"<c><v>{float(value)!r}</v></c>"


SWING = [("Zeit (s)", "Winkel (deg)"), *zip(T_S, DEG, strict=True)]


@pytest.mark.parametrize("name", ["swing.xlsx", "swing.xls", "swing.csv"])
def test_excel_file_is_read_whatever_its_name(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(workbook(Run=SWING, Empty=[]))
    np.testing.assert_allclose(read_trajectory(path).position[:, 0], THETA, atol=1e-6)


def test_excel_file_with_several_sheets_asks_which(tmp_path):
    path = tmp_path / "swings.xlsx"
    path.write_bytes(workbook(First=[("t (s)", "x (m)"), (0, 1), (1, 2)], Second=SWING))
    with pytest.raises(DataError, match=r"has the sheets First, Second; name one: .*swings\.xlsx:First"):
        read_trajectory(path)
    trajectory = read_trajectory(f"{path}:Second")
    np.testing.assert_allclose(trajectory.position[:, 0], THETA, atol=1e-6)
    with pytest.raises(DataError, match="has no sheet 'Third'; it has First, Second"):
        read_trajectory(f"{path}:Third")


def test_excel_file_that_claims_to_be_huge_is_refused_before_it_is_unpacked(tmp_path):
    path = tmp_path / "bomb.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book, book.open("xl/sheet.xml", "w") as member:
        for _ in range(260):
            member.write(bytes(1_000_000))
    with pytest.raises(DataError, match="unpacks to 260 MB"):
        read_trajectory(path)


@pytest.mark.parametrize(
    "cell", ["1" * LONG + "x", "1." * LONG, f"a[{' ' * LONG}x", f"a{' in' * LONG}", "a" + "1" * LONG + "b"]
)
@pytest.mark.parametrize("table", ["{}", "Zeit (s);{}\n0;1\n1;2\n2;3\n", "Zeit (s);Winkel (rad)\n0;1\n1;{}\n2;3\n"])
def test_long_cell_is_read_or_refused_in_time_that_grows_with_its_length(tmp_path, table, cell):
    (tmp_path / "t.csv").write_text(table.format(cell))
    start = time.process_time()
    with suppress(DataError):
        read_trajectory(tmp_path / "t.csv")
    assert time.process_time() - start < 2.0  # minutes where it grew with the square


def test_columns_that_are_shown_as_an_example_are_outputs_not_inputs(tmp_path):
    (tmp_path / "t.csv").write_text("t_s,u_V,y_V\n0,1,0\n1,1,1\n2,1,2\n")
    assert columns_for(tmp_path / "t.csv", [Quantity("z", "m")]) == {"t": "t_s", "z[m]": "y_V"}


@pytest.mark.parametrize(
    ("header", "unit", "factor"),
    [
        ("Zeit (s),v (km/h)", "m/s", 1 / 3.6),
        ("t_s,v_km/h", "m/s", 1 / 3.6),
        ("time,speed_mph", "m/s", 0.44704),
        ("t_s,n_rpm", "rad/s", np.pi / 30),
        ("t / s,n / rev/min", "rad/s", np.pi / 30),
        ("t_s,u_V,v_ft/s", "m/s", 0.3048),
        ("t_s,s_ft", "m", 0.3048),
        ("t_s,x_in", "m", 0.0254),
    ],
)
def test_speeds_and_lengths_are_read_in_the_units_of_people(tmp_path, header, unit, factor):
    columns = [T_S, *[THETA] * header.count(",")]
    (tmp_path / "table.csv").write_text(f"{header}\n{rows(*columns)}")
    read = read_trajectory(tmp_path / "table.csv")
    assert [quantity.unit for quantity in read.quantities] == [unit]
    np.testing.assert_allclose(read.position[:, 0], factor * THETA, rtol=1e-12)
    assert any("column" in line for line in read.origin["read_as"])


@pytest.mark.parametrize(
    ("title", "name", "kelvin"),
    [
        ("Temperature (°C)", "temperature", THETA + 273.15),
        ("T_degC", "temperature", THETA + 273.15),
        ("plate / °F", "plate", (THETA + 459.67) * 5 / 9),
    ],
)
def test_temperatures_of_a_thermometer_are_read_in_kelvin(tmp_path, title, name, kelvin):
    (tmp_path / "table.csv").write_text(f"Time (s),{title}\n" + rows(T_S, THETA), encoding="utf-8")
    read = read_trajectory(tmp_path / "table.csv")
    assert [(quantity.name, quantity.unit) for quantity in read.quantities] == [(name, "K")]
    np.testing.assert_allclose(read.position[:, 0], kelvin, rtol=1e-12)
    assert any(line.endswith(("in degC", "in degF")) for line in read.origin["read_as"])


def test_speed_beside_a_position_is_left_to_the_position(tmp_path):
    (tmp_path / "table.csv").write_text("Time (s),x (m),v (km/h)\n" + rows(T_S, THETA, DEG))
    assert [quantity.name for quantity in read_trajectory(tmp_path / "table.csv").quantities] == ["x"]


def test_field_of_a_structure_is_named_by_its_last_name(tmp_path):
    savemat(tmp_path / "rig.mat", {"data": {"u": T_S[None], "counts": np.arange(12, dtype=np.int32)[None], "Ts": 0.04}})
    read = read_trajectory(tmp_path / "rig.mat", {"u[V]": "u", "phi[0.5 rad]": "counts"})
    np.testing.assert_allclose(read.position[:, 0], 0.5 * np.arange(12))
    np.testing.assert_allclose(read.inputs[:, 0], T_S)
    np.testing.assert_allclose(read.t_s, T_S)
