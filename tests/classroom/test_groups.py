"""Groups: found in folders and tables, with names that every file system takes, in an order that people expect."""

import pytest

from iris_sysid.classroom.groups import Source, sources_in
from iris_sysid.errors import DataError


def touched(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("t_s,x_m\n")
    return folder


def test_groups_are_the_clips_and_tables_of_a_folder_in_the_order_of_their_numbers(tmp_path):
    touched(tmp_path, "group10.mp4", "group9.csv", "runs/trajectory.csv", "runs/fit.json", "b/clip.mov")
    touched(tmp_path, "groups.csv", ".hidden.csv", "notes.pdf", "group9.truth.csv")
    assert [source.group for source in sources_in(tmp_path)] == ["b", "group9", "group10", "runs"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "holds no group: put a clip or a table of each group into it"),
        (("a.mp4", "a.csv"), "two groups are called 'a'"),
        (("g/a.mp4", "g/b.mp4"), "holds several clips or tables"),
    ],
)
def test_a_folder_that_is_no_class_is_refused(tmp_path, names, message):
    with pytest.raises(DataError, match=message):
        sources_in(touched(tmp_path, *names))


def test_names_of_folders_are_safe_and_differ_where_names_do(tmp_path):
    names = ["7", "../../etc", "a/b", "a:b", "CON", "con", "x" * 300, "Ärger <b>", "", ".", "A", "a"]
    folders = [Source(name, tmp_path).folder for name in names]
    assert len({folder.casefold() for folder in folders}) == len(names)
    assert all(len(folder) < 80 and not set(folder) & set('/\\:*?"<>|') for folder in folders)
    assert folders[0] == "7"
    assert not any(folder.strip(".") == "" or folder.lower() in ("con", "aux") for folder in folders)


def test_a_table_without_a_column_of_groups_says_which_columns_it_has(tmp_path):
    (tmp_path / "one.csv").write_text("t_s,theta_rad\n" + "".join(f"{k},{k}\n" for k in range(9)))
    with pytest.raises(DataError, match=r"no column that names the groups; its columns are 't_s', 'theta_rad'"):
        sources_in(tmp_path / "one.csv")
    with pytest.raises(DataError, match="has no column 'team'"):
        sources_in(tmp_path / "one.csv", "team")
