"""The files for contributors agree with the code: one version, every field of an effect, forms that parse."""

import dataclasses
import re

import pytest
import yaml

import iris_sysid
from iris_sysid import Effect
from tests._project import ROOT

CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("[!c]*.yml"))
MAPS = {"acceleration", "observe", "image", "warp", "drive"}
KINDS = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def loaded(name: str):
    return yaml.safe_load((ROOT / name).read_text("utf-8"))


def test_contributing_explains_every_field_of_an_effect_and_no_other():
    section = CONTRIBUTING.partition("## Add an effect")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (?!field|one map|-)(`.*?) \|", section, re.MULTILINE)
    explained = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert explained | MAPS == {field.name for field in dataclasses.fields(Effect)}
    assert all(f"`{name}`" in section for name in MAPS)


def test_citation_and_changelog_are_of_the_version_that_is_installed():
    cited = loaded("CITATION.cff")
    heads = re.findall(
        r"^## (\d+\.\d+\.\d+) \((\d{4}-\d{2}-\d{2})\)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M
    )
    assert cited["version"] == iris_sysid.__version__ == heads[0][0]
    assert str(cited["date-released"]) == heads[0][1]


def test_changelog_keeps_to_its_kinds_of_change_and_to_one_section_each():
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    for version in text.split("\n## ")[1:]:
        kinds = re.findall(r"^### (.*)$", version, re.MULTILINE)
        assert set(kinds) <= KINDS
        assert len(kinds) == len(set(kinds))


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.name)
def test_issue_form_has_a_name_and_asks_something_that_must_be_answered(path):
    form = yaml.safe_load(path.read_text("utf-8"))
    assert form["name"]
    assert form["description"]
    identifiers = [field["id"] for field in form["body"]]
    assert len(identifiers) == len(set(identifiers))
    assert any(field.get("validations", {}).get("required") for field in form["body"])


def test_hooks_before_a_commit_run_what_lint_runs():
    (repository,) = loaded(".pre-commit-config.yaml")["repos"]
    entries = " ".join(hook["entry"] for hook in repository["hooks"])
    for tool in ("ruff check", "ruff format", "mypy"):
        assert tool in entries
        assert tool in (ROOT / "Makefile").read_text("utf-8")
