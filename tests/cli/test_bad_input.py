"""Bad input to every command: one clear line, exit 1 or 2, nothing written, nothing half-written."""

import os
import re
from pathlib import Path

import pytest
import typer

from iris_sysid.cli import app
from tests.conftest import listing

CLIPS = ("pendulum", "still", "leaving", "two_movers", "one_frame", "text", "cut")
TABLES = {
    "unsorted.csv": "t_s,theta_rad\n0,0.1\n0.2,0.2\n0.1,0.3\n",
    "duplicate.csv": "t_s,theta_rad\n0,0.1\n0.1,0.2\n0.1,0.3\n",
    "nan_time.csv": "t_s,theta_rad\n0,0.1\nnan,0.2\n0.1,0.3\n",
    "all_nan.csv": "t_s,theta_rad\n" + "".join(f"{k / 10},nan\n" for k in range(30)),
    "words.csv": "t_s,theta_rad\n0,0.1\n0.1,much\n",
    "no_time.csv": "hours,theta_rad\n0,0.1\n0.1,0.2\n",
    "no_quantity.csv": "t_s\n0\n0.1\n",
    "no_unit.csv": "t_s,theta\n0,0.1\n0.1,0.2\n",
    "wrong_unit.csv": "t_s,theta_m\n" + "".join(f"{k / 10},{k % 7}\n" for k in range(30)),
    "header.csv": "t_s,theta_rad\n",
    "one_row.csv": "t_s,theta_rad\n0,0.1\n",
    "empty.csv": "",
    "project.trk": '<object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel"></object>',
    "binary.csv": "\x00\x01\x02",
    "ragged.csv": "t_s,theta_rad\n0,0.1\n0.1\n",
    "track.csv": "frame,t_s,body,x_px,y_px\n0,0,1,3,4\n1,0.1,1,3,4\n",
    "short.csv": "t_s,theta_rad\n0,0.1\n0.1,0.2\n0.2,0.1\n0.3,nan\n",
    "constant.csv": "t_s,theta_rad\n" + "".join(f"{k / 10},0.5\n" for k in range(30)),
}


@pytest.fixture
def folder(tmp_path, request, monkeypatch) -> Path:
    """The current folder, holding the tables above, a file that is there already, and a folder of a result."""
    for name, text in TABLES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "taken.csv").write_text("mine")
    (tmp_path / "taken.json").write_text("mine")
    (tmp_path / "taken.mp4").write_text("mine")
    (tmp_path / "taken.png").write_text("mine")
    for name in ("report.html", "diagnosis.json", "report/report.html", "diagnosis/report.html"):
        (tmp_path / "taken" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "taken" / name).write_text("mine")
    (tmp_path / "good.csv").symlink_to(request.getfixturevalue("angles"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(arguments, status, message, folder, cli, request):
    """Run the command line and check that it stops in one line and leaves the folder as it was."""
    for word in set(re.findall(r"\b(\w+)\.mp4\b", arguments)):
        if word in CLIPS:
            (folder / f"{word}.mp4").symlink_to(request.getfixturevalue(f"{word}_clip"))
    before = listing(folder)
    outcome = cli(*arguments.split())
    assert outcome.status == status, outcome
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    by_hand = "frame(s)" not in outcome.err  # what no tracker follows may be, but not in one frame
    if by_hand and lines[-1].startswith("next: iris-sysid review "):
        lines.pop()
    assert re.search(message, lines[-1]), outcome.err
    if status == 1:
        assert len(lines) == 1, outcome.err
        assert lines[0].startswith("iris-sysid: ")
        assert "unexpected" not in lines[0]
    assert "Traceback" not in outcome.err
    assert listing(folder) == before


RUN = "--phenomenon pendulum -o out"
FIT = "--model pendulum -o fit.json"

USAGE = [
    ("walk", "No such command 'walk'"),
    ("run", "Missing argument '{?video}?'"),
    ("run pendulum.mp4", "Missing option"),
    ("run pendulum.mp4 --phenomenon pendulum", "Missing option '(-o|--output)'"),
    (f"run pendulum.mp4 {RUN} --speed 3", "No such option: --speed"),
    (f"run pendulum.mp4 {RUN} --fps fast", "Invalid value for '--fps': Input should be a valid number"),
    (f"run pendulum.mp4 second.mp4 {RUN}", "unexpected extra argument"),
    (
        "track pendulum.mp4 -o t.csv --bodies 0",
        "Invalid value for '--bodies': Input should be greater than or equal to 1",
    ),
    ("track pendulum.mp4 -o t.csv --bodies two", "Invalid value for '--bodies': Input should be a valid integer"),
    ("track pendulum.mp4", "Missing option '(-o|--output)'"),
    ("smooth", "Missing argument"),
    ("smooth good.csv", "Missing option"),
    ("fit good.csv -o fit.json", "Missing option '--model'"),
    ("diagnose good.csv --model pendulum", "Missing option '(-o|--output)'"),
    (
        "diagnose good.csv --model pendulum -o out --holdout 0.95",
        "Invalid value for '--holdout': Input should be less than or equal to 0.9",
    ),
    ("diagnose good.csv --model pendulum -o out --holdout nan", "Invalid value for '--holdout'"),
    ("render -o clip.mp4", "Missing option '--phenomenon'"),
    (
        "render --phenomenon pendulum -o clip.mp4 --seed x",
        "Invalid value for '--seed': Input should be a valid integer",
    ),
    ("demo now", "unexpected extra argument"),
    ("list all", "unexpected extra argument"),
    ("schema", "Missing argument"),
]

RUN_TABLE = [
    # the clip
    (f"run no.mp4 {RUN}", "there is no file no.mp4"),
    (f"run text.mp4 {RUN}", "text.mp4 cannot be read as a video: it is a text file"),
    (f"run good.csv {RUN}", "good.csv cannot be read as a video"),
    (f"run cut.mp4 {RUN}", "cut.mp4 .*frame"),
    (f"run taken {RUN}", "taken"),
    (f"run still.mp4 {RUN}", "nothing moves in the clip beyond the noise"),
    (f"run one_frame.mp4 {RUN}", r"the clip has 1 frame\(s\)"),
    ("run one_frame.mp4 -o out", r"the clip has 1 frame\(s\); a motion takes at least 3"),
    (f"run leaving.mp4 {RUN}", "no arc|too small to fix the pivot|samples|straight"),
    (f"run two_movers.mp4 {RUN}", "too small to fix the pivot: .*--mark pivot=X,Y"),
    (f"run pendulum.mp4 {RUN} --start 1 --stop 1.05", r"the clip has 2 frame\(s\)"),
    (f"run pendulum.mp4 {RUN} --start 9", "no frame lies between 9.* 90 frames were read, up to 2.9"),
    (f"run pendulum.mp4 {RUN} --start 2 --stop 1", r"from 2\.0 s to 1\.0 s is empty \(--start, --stop\)"),
    (f"run pendulum.mp4 {RUN} --start nan", r"is empty \(--start, --stop\)"),
    (f"run pendulum.mp4 {RUN} --fps 0", r"the frame rate must be above 0 and finite, not 0\.0 \(--fps\)"),
    (f"run pendulum.mp4 {RUN} --fps -30", "the frame rate must be above 0"),
    (f"run pendulum.mp4 {RUN} --fps nan", "the frame rate must be above 0"),
    # names
    ("run pendulum.mp4 --phenomenon pendulums -o out", "no phenomenon is named 'pendulums'; did you mean 'pendulum'"),
    (f"run pendulum.mp4 {RUN} --tracker sort", "no tracker is named 'sort'; there are: .*median-background"),
    (f"run pendulum.mp4 {RUN} --set lenght=1", "pendulum has nothing named 'lenght'; it has length, damping"),
    (f"run pendulum.mp4 {RUN} --colour ultraviolet", "no colour is named 'ultraviolet'.*red, orange"),
    # forms
    (f"run pendulum.mp4 {RUN} --roi 0,0,999,9", "does not lie in the image, which is 160 px wide and 90 px high"),
    (f"run pendulum.mp4 {RUN} --set arc_radius=0.5m", "arc_radius is given in m, but positions are in px"),
    (f"run pendulum.mp4 {RUN} --set length=50px", "length is given in px, but it is in m here"),
    (f"run pendulum.mp4 {RUN} --set pivot_x=3", "a pivot needs both pivot_x and pivot_z"),
    # scale
    (f"run pendulum.mp4 {RUN} --scale 100", "'100' has no unit; units are px, m, cm, mm; write it as 640px=1m"),
    (f"run pendulum.mp4 {RUN} --scale gravity=9.8m", r"gravity is in m/s\^2, not in m"),
    (f"run pendulum.mp4 {RUN} --scale-bar 1,2,3=1m", "cannot read the scale bar '1,2,3=1m'; write it as x1,y1,x2,y2"),
    (f"run pendulum.mp4 {RUN} --scale 9px=1m --scale-bar 1,2,9,9=1m", "give one of --scale, --scale-bar and --calibra"),
    (f"run pendulum.mp4 {RUN} --scale 9px=1m --calibration taken.json", "give one of --scale, --scale-bar and --calib"),
    (f"run pendulum.mp4 {RUN} --calibration no.json", "cannot read no.json: No such file"),
    (f"run pendulum.mp4 {RUN} --calibration taken.json", "taken.json: Invalid JSON"),
    (f"run pendulum.mp4 {RUN} --calibration no.trk", "no.trk"),
    ("run pendulum.mp4 --phenomenon projectile -o out --set gravity=9.8", "gravity is given in m/s.*give the scale"),
    # outputs
    ("run pendulum.mp4 --phenomenon pendulum -o taken", "taken/report.html exists already; .*--force to replace it"),
    ("run pendulum.mp4 --phenomenon pendulum -o taken.csv", "cannot write taken.csv/.*is a file, not a folder"),
    ("run pendulum.mp4 --phenomenon pendulum -o /proc/1/x", "cannot write /proc/1/x"),
]  # fmt: skip

TRACK_TABLE = [
    ("track no.mp4 -o t.csv", "there is no file no.mp4"),
    ("track text.mp4 -o t.csv", "it is a text file"),
    ("track cut.mp4 -o t.csv", "cut.mp4"),
    ("track still.mp4 -o t.csv", "nothing moves in the clip"),
    ("track one_frame.mp4 -o t.csv", r"the clip has 1 frame\(s\)"),
    ("track leaving.mp4 -o t.csv --bodies 2", r"2 bodies were requested, but only 1 move\(s\)"),
    ("track two_movers.mp4 -o t.csv --bodies 3", "3 bodies were requested, but no frame shows that number at once"),
    ("track pendulum.mp4 -o t.csv --phenomenon swing", "no phenomenon is named 'swing'"),
    ("track pendulum.mp4 -o t.csv --tracker swing", "no tracker is named 'swing'; there are"),
    ("track pendulum.mp4 -o t.csv --colour #12", "no colour is named '#12'; write #rrggbb"),
    ("track pendulum.mp4 -o t.csv --roi left", "cannot read 'left': it must be x,y,width,height"),
    ("track pendulum.mp4 -o t.csv --fps inf", "the frame rate must be above 0 and finite"),
    ("track pendulum.mp4 -o taken.csv", "taken.csv exists already; give another name, or --force"),
    ("track pendulum.mp4 -o t.csv --overlay taken.mp4", "taken.mp4 exists already"),
    ("track pendulum.mp4 -o t.csv --overlay o.avi", "cannot write o.avi: it will be a .mp4 file"),
    ("track pendulum.mp4 -o t.mp4 --overlay t.mp4", "cannot write t.mp4: two results would go there"),
    ("track pendulum.mp4 -o pendulum.mp4 --force", "cannot write pendulum.mp4: it is what is read"),
    ("track pendulum.mp4 -o .", "cannot write .: it is a folder"),
    ("track pendulum.mp4 -o taken.csv/t.csv", "is a file, not a folder"),
]

TABLE_TABLE = [
    ("no.csv", "no.csv"),
    ("taken", "taken"),
    ("text.mp4", "text.mp4"),
    ("unsorted.csv", "line 4.*t_s.*is not later than 0.2 in line 3; sort the rows by time"),
    ("duplicate.csv", "line 4.*is not later than 0.1 in line 3; sort the rows by time, without duplicates"),
    ("nan_time.csv", "nan_time.csv.*line 3.*t_s"),
    ("words.csv", "words.csv.*line 3.*theta_rad.*much"),
    ("no_time.csv", "no_time.csv has no column t_s"),
    ("no_quantity.csv", "has no quantity beside t_s"),
    ("no_unit.csv", "no_unit.csv: .*theta"),
    ("header.csv", "header.csv"),
    ("empty.csv", "empty.csv"),
    ("binary.csv", "binary.csv"),
    ("ragged.csv", "ragged.csv.*line 3"),
    ("track.csv", "is a track, in pixels; it needs .*iris-sysid run"),
    ("all_nan.csv", "all_nan.csv: no line has a value for theta_rad; there is nothing to use"),
    ("one_row.csv", "one_row.csv holds one sample; a trajectory needs at least 2"),
]

SMOOTH_TABLE = [(f"smooth {name} -o s.csv", message) for name, message in TABLE_TABLE] + [
    ("smooth good.csv -o taken.csv", "taken.csv exists already; give another name, or --force"),
    ("smooth good.csv -o good.csv --force", "cannot write good.csv: it is what is read"),
    ("smooth good.csv -o /proc/1/s.csv", "cannot write /proc/1/s.csv"),
]

FIT_TABLE = [(f"fit {name} {FIT}", message) for name, message in TABLE_TABLE] + [
    (f"fit wrong_unit.csv {FIT}", "model 'pendulum' needs theta in rad, but it is in m"),
    ("fit good.csv --model pendulun -o fit.json", "no model is named 'pendulun'; did you mean 'pendulum'"),
    ("fit good.csv --model free-fall -o fit.json", "model free-fall observes z, .* --columns"),
    (f"fit good.csv {FIT} --set lenght=1", "model 'pendulum' has no parameter 'lenght'; it has length, damping"),
    (f"fit good.csv {FIT} --free mass", "model 'pendulum' has no parameter 'mass'"),
    (f"fit good.csv {FIT} --start-at mass=1", "model 'pendulum' has no parameter 'mass'"),
    (f"fit good.csv {FIT} --start-at length", "cannot read the setting 'length'"),
    (f"fit good.csv {FIT} --set gravity=9.8 --set gravity=9.9", "the setting 'gravity' is given twice"),
    (f"fit good.csv {FIT} --set gravity=9.8 --free gravity", "gravity cannot be both fixed and free"),
    (f"fit good.csv {FIT} --set gravity=9.8deg", r"gravity is in m/s\^2, not in rad"),
    (f"fit good.csv {FIT} --set length=-1", "length must lie within 0.001 to 200 m, not -1"),
    ("fit good.csv --model pendulum -o taken.json", "taken.json exists already"),
    (f"fit good.csv {FIT} --plot taken.png", "taken.png exists already"),
    (f"fit good.csv {FIT} --plot fit.pdf", "cannot write fit.pdf: it will be a .png file"),
    ("fit good.csv --model pendulum -o x.png --plot x.png", "two results would go there"),
    ("fit good.csv --model pendulum -o good.csv --force", "it is what is read"),
]

DIAGNOSE = "--model pendulum -o out"
DIAGNOSE_TABLE = [(f"diagnose {name} {DIAGNOSE}", message) for name, message in TABLE_TABLE] + [
    (f"diagnose wrong_unit.csv {DIAGNOSE}", "model 'pendulum' needs theta in rad, but it is in m"),
    (f"diagnose short.csv {DIAGNOSE}", "the base model cannot be diagnosed, its fit failed .too-short"),
    (f"diagnose good.csv {DIAGNOSE} --sensor radar", "there is no sensor 'radar'; write camera, encoder, gauge"),
    (
        f"diagnose good.csv {DIAGNOSE} --keep-component drag",
        "there is no part of a residual called 'drag'; write force-of-velocity, force-of-position",
    ),
    ("diagnose good.csv --model swing -o out", "no model is named 'swing'; there are"),
    (f"diagnose good.csv {DIAGNOSE} --set mass=1", "model 'pendulum' has no parameter 'mass'"),
    (f"diagnose good.csv {DIAGNOSE} --free mass", "model 'pendulum' has no parameter 'mass'"),
    ("diagnose good.csv --model pendulum -o taken", "exists already"),
    ("diagnose good.csv --model pendulum -o taken.csv", "is a file, not a folder"),
]

RENDER = "render --phenomenon pendulum -o c.mp4"
RENDER_TABLE = [
    ("render --phenomenon swing -o c.mp4", "no scene is named 'swing'; there are"),
    ("render --phenomenon pendulum -o c.txt", "cannot tell the video format of 'c.txt'; use one of .mp4"),
    ("render --phenomenon pendulum -o taken.mp4", "taken.mp4 exists already"),
    ("render --phenomenon pendulum -o taken.csv/c.mp4", "is a file, not a folder"),
    (f"{RENDER} --effect magic=1", "pendulum has no effect 'magic'; .*there are: .*quadratic-drag"),
    (f"{RENDER} --effect quadratic-drag", "cannot read the effect 'quadratic-drag': write it as quadratic-drag=0.08"),
    (f"{RENDER} --effect quadratic-drag=1e999", "must be a finite number, not inf"),
    (f"{RENDER} --set mass=1", "pendulum has no parameter 'mass'; there are: length"),
    (f"{RENDER} --set length=-1", "length of pendulum must lie within"),
    (f"{RENDER} --set length=30deg", "length is in m, not in rad"),
    (f"{RENDER} --size big", "cannot read the size 'big': write it as 1280x720"),
    (f"{RENDER} --size 63x48", "size must be two even numbers"),
    (f"{RENDER} --size 0x0", "size must be two even numbers"),
    (f"{RENDER} --fps 0", "fps must lie between 0.1 and 1000, not 0.0"),
    (f"{RENDER} --fps nan", "fps must lie between"),
    (f"{RENDER} --seconds 0", "the clip must last at least two frames"),
    (f"{RENDER} --seconds -1", "the clip must last at least two frames"),
    (f"{RENDER} --seconds nan", "the clip must last at least two frames"),
    (f"{RENDER} --seconds inf", "frames"),
    (f"{RENDER} --seed -1", "seed must be a whole number of at least 0"),
]

OTHER_TABLE = [
    ("review one_frame.mp4 -o out --phenomenon nosuch --no-browser", "no phenomenon is named 'nosuch'"),
    ("review one_frame.mp4 -o good.csv --no-browser", "is a file, not a folder"),
    ("gt nothere -o p.json", "nothere is not a folder that can be read"),
    ("gt taken -o p.json", "taken has no class of a data set"),
    ("gt taken --measured good.csv -o p.json", "good.csv: Invalid JSON"),
    ("gt taken --time-base 2 -o p.json", "'2' has no unit; units are ppm, %"),
    ("class nothere --phenomenon pendulum -o c", "cannot read nothere: No such file"),
    ("class good.csv --phenomenon pendulum -o c", "good.csv has no column that names the groups"),
    ("class good.csv --group-column team --phenomenon pendulum -o c", "good.csv has no column 'team'"),
    ("class text.mp4 --phenomenon pendulum -o c", "text.mp4"),
    ("class good.csv --phenomenon swing -o c", "no phenomenon is named 'swing'"),
    ("class good.csv --phenomenon pendulum --known length -o c", "cannot read the setting 'length'"),
    ("sealed no.sealed", "no.sealed"),
    ("sealed good.csv --fit no.json", "no.json"),
    ("sealed empty.csv --keep 20% -o parts", "empty.csv"),
    ("benchmark -o out", "there is nothing to make a table from"),
    ("benchmark --latent good.csv -o out", "write --latent as NAME=FILE"),
    ("benchmark --latent a=no.csv -o out", "no.csv does not exist"),
    ("benchmark --predictions a=good.csv -o out", "good.csv has no column"),
    ("benchmark --rows good.csv -o out", "good.csv has no column 'study'"),
    ("import no.trz -o t.csv", "no.trz"),
    ("import good.csv -o t.csv", "good.csv"),
    ("import text.mp4 -o t.csv", "text.mp4"),
    ("import project.trk -o taken.csv", "taken.csv exists already"),
    ("import project.trk -o t.csv", "project.trk has no coordinate system: open it in Tracker"),
    ("calibrate good.csv -o c.json", "a board needs both --board 9x6 and --square 25mm"),
    ("calibrate good.csv --board 9x6 -o c.json", "a board needs both --board 9x6 and --square 25mm"),
    ("calibrate no.png --board 9x6 --square 25mm -o c.json", "cannot read no.png: No such file"),
    ("calibrate text.mp4 --board 9x6 --square 25mm -o c.json", "text.mp4"),
    ("calibrate taken --board 9x6 --square 25mm -o c.json", "there is no image in taken"),
    ("frame no.mp4 -o f.png", "no.mp4"),
    ("plan no.json good.csv -o p", "cannot read no.json: No such file"),
    ("plan --to nothing=0.1 --phenomenon pendulum -o p", "no effect is named 'nothing'; there are: .*quadratic-drag"),
    ("frame text.mp4 -o f.png", "text.mp4"),
    ("frame no.mp4 -o f.jpg", "end its name with .png"),
    ("discover no.csv -o d.json", "no.csv"),
    ("discover unsorted.csv -o d.json", "t_s"),
    ("discover good.csv -o taken.csv", "taken.csv exists already"),
    ("petab no.yaml -o p", "cannot read no.yaml: No such file"),
    ("petab good.csv -o p", "a table is exported with its model: give --equation"),
    ("petab good.csv --equation theta'=-k*u -o p", "cannot hold the table of the input u"),
    ("petab good.csv --equation theta'=-k -o p --start-at m=1", "the equation has no parameter 'm'; it has k, theta_0"),
    ("demo -o taken", "exists already"),
    ("demo -o taken.csv", "is a file, not a folder"),
    ("schema parameter", "no file is named 'parameter'; there are: .*fit"),
]

TABLES_OF_COMMANDS = (RUN_TABLE, TRACK_TABLE, SMOOTH_TABLE, FIT_TABLE, DIAGNOSE_TABLE, RENDER_TABLE, OTHER_TABLE)


@pytest.mark.parametrize(("arguments", "message"), USAGE)
def test_wrong_usage_is_exit_2_with_the_reason(arguments, message, folder, cli, request):
    refused(arguments, 2, message, folder, cli, request)


@pytest.mark.parametrize(("arguments", "message"), [row for table in TABLES_OF_COMMANDS for row in table])
def test_command_refuses_in_one_line(arguments, message, folder, cli, request):
    refused(arguments, 1, message, folder, cli, request)


def test_every_command_has_bad_input():
    tried = {arguments.split(" ")[0] for table in (USAGE, *TABLES_OF_COMMANDS) for arguments, _ in table}
    assert set(typer.main.get_command(app).commands) <= tried


@pytest.mark.parametrize("name", ["short.csv", "constant.csv"])
def test_fit_to_a_table_without_a_motion_is_a_failed_fit(name, folder, cli):
    outcome = cli("fit", name, "--model", "pendulum", "-o", "fit.json")
    assert outcome.out.split(":")[0] in ("failed", "doubtful")
    assert (outcome.status == 1) == outcome.out.startswith("failed: ")
    assert "unexpected" not in outcome.err
    assert "nan" not in outcome.out
    assert (folder / "fit.json").is_file()


def test_folder_without_permission_is_refused(folder, cli, monkeypatch):
    monkeypatch.setattr("iris_sysid.io.files.os.access", lambda _, mode: not mode & os.W_OK)
    outcome = cli("smooth", "good.csv", "-o", "s.csv")
    assert outcome.status == 1
    assert "no permission to write in" in outcome.err
    assert not (folder / "s.csv").exists()


def test_outputs_are_checked_before_the_long_work(folder, cli, monkeypatch):
    def work(*_, **__):
        raise AssertionError("the work began")

    for module, name in (
        ("iris_sysid.pipeline.one_clip", "run"),
        ("iris_sysid.pipeline.one_clip", "track"),
        ("iris_sysid.trajectory.smoothing", "smooth"),
        ("fitters.ode.single_clip", "fit"),
        ("iris_sysid.diagnosis.diagnose", "diagnose"),
        ("iris_sysid.synthetic.clip", "plan_clip"),
    ):
        monkeypatch.setattr(f"{module}.{name}", work)
    for command in (
        "run pendulum.mp4 --phenomenon pendulum -o taken",
        "track pendulum.mp4 -o taken.csv",
        "track pendulum.mp4 -o t.csv --overlay taken.mp4",
        "smooth good.csv -o taken.csv",
        "fit good.csv --model pendulum -o taken.json",
        "fit good.csv --model pendulum -o f.json --plot taken.png",
        "diagnose good.csv --model pendulum -o taken",
        "render --phenomenon pendulum -o taken.mp4",
    ):
        assert "exists already" in cli(*command.split()).err, command


def test_name_with_control_characters_makes_one_line(folder, cli):
    outcome = cli("smooth", "a\nb\x1b[31m.csv", "-o", "s.csv")
    assert outcome.status == 1
    assert len(outcome.err.splitlines()) == 1
    assert "\x1b" not in outcome.err
    assert r"a\nb\x1b[31m.csv" in outcome.err
