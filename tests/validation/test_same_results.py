"""Comparison of two commits: which numbers are compared, under which names, and when they are equal."""

import json

import pytest

from validation import same_results


def compare(folder, before, after):
    paths = []
    for name, numbers in (("before", before), ("after", after)):
        paths.append(folder / f"{name}.json")
        paths[-1].write_text(json.dumps(numbers), encoding="utf-8")
    options = type("Options", (), {"files": paths, "rtol": 1e-6, "atol": 1e-15})
    return same_results.compare(options)


def test_equal_numbers_are_no_difference(tmp_path, capsys):
    assert compare(tmp_path, {"a/g": 9.81, "a/status": "ok"}, {"a/g": 9.81 * (1 + 1e-9), "a/status": "ok"}) == 0
    assert capsys.readouterr().out == "0 differences among 2 numbers before, 2 after\n"


@pytest.mark.parametrize("after", [{"a/g": 9.82}, {}, {"a/g": "null"}])
def test_changed_and_missing_numbers_are_differences(tmp_path, after, capsys):
    assert compare(tmp_path, {"a/g": 9.81}, after) == 1
    assert capsys.readouterr().out.startswith("a/g: 9.81 -> ")


def test_renamed_names_are_the_same(tmp_path):
    old, new = next(iter(same_results.RENAMED.items()))
    assert compare(tmp_path, {f"a/{old}/g": 1.0, "a/name": old}, {f"a/{new}/g": 1.0, "a/name": new}) == 0


def test_former_command_is_run_where_the_new_one_does_not_exist(tmp_path):
    assert same_results.commands_of(tmp_path)["audit"].startswith("benchmark --audit ")
    module = tmp_path / "validation" / "audit" / "__main__.py"
    module.parent.mkdir(parents=True)
    module.touch()
    assert same_results.commands_of(tmp_path)["audit"].startswith("python -m validation.audit ")
