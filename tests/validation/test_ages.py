"""No table of the docs is older than the code that it measures without saying so."""

import subprocess

import pytest

from validation import ages

TABLE = "# A page\n\n<!-- table: a -->\n*`python -m validation.plans`, commit {commit}, 2026-11-20{note}*\n\n| a |\n"


def git(folder, *arguments):
    names = ["-c", "user.name=a", "-c", "user.email=a@b"]
    done = subprocess.run(["git", "-C", folder, *names, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.fixture
def history(tmp_path, monkeypatch):
    """A project with code of one commit, and a page whose table is of it."""
    git(tmp_path, "init", "-q")
    (tmp_path / "fitters" / "ode").mkdir(parents=True)
    (tmp_path / "fitters" / "ode" / "a.py").write_text("A = 1\n", encoding="utf-8")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "code")
    (tmp_path / "plans.md").write_text(TABLE.format(commit=git(tmp_path, "rev-parse", "HEAD")[:9], note=""), "utf-8")
    monkeypatch.setattr(ages, "ROOT", tmp_path)
    ages.differs.cache_clear()
    yield tmp_path
    ages.differs.cache_clear()


def changed(folder):
    (folder / "fitters" / "ode" / "a.py").write_text("A = 2\n", encoding="utf-8")
    git(folder, "commit", "-qam", "other code")


def test_table_of_the_code_as_it_is_says_nothing(history):
    (header,) = ages.headers(history)
    assert not header.is_old
    assert header.right == header.text


def test_table_whose_code_has_changed_must_say_so(history):
    changed(history)
    (header,) = ages.headers(history)
    assert header.is_old
    assert header.right == header.text[:-1] + ages.NOTE + "*"
    page = history / "plans.md"
    page.write_text(page.read_text(encoding="utf-8").replace(header.text, header.right), encoding="utf-8")
    (header,) = ages.headers(history)
    assert header.says_old
    assert header.right == header.text


@pytest.mark.parametrize(
    ("before", "after", "is_old"),
    [
        ("def f():\n    return 1\n", '# a remark\ndef f():\n    """One."""\n    return 1\n', False),
        ("from a import f\n\nB = f(1)\n", "from c.d import f\n\nB = f(1)\n", False),
        ("from a import f\n\nB = f(1)\n", "from a import g as f\n\nB = f(1)\n", True),
        ("import a\n\nB = a.f(1)\n", "import c as a\n\nB = a.f(1)\n", True),
        ("def f():\n    return 1\n", "def f():\n    return 2\n", True),
    ],
)
def test_only_what_the_code_does_counts(history, before, after, is_old):
    for text in (before, after):
        (history / "fitters" / "ode" / "a.py").write_text(text, encoding="utf-8")
        git(history, "commit", "-qam", "code")
        if text is before:
            (history / "plans.md").write_text(
                TABLE.format(commit=git(history, "rev-parse", "HEAD")[:9], note=""), "utf-8"
            )
    (header,) = ages.headers(history)
    assert header.is_old == is_old


def test_commit_that_the_history_lacks_is_an_error(history):
    (history / "plans.md").write_text(TABLE.format(commit="0123456789", note=""), encoding="utf-8")
    (header,) = ages.headers(history)
    with pytest.raises(LookupError, match="no commit 0123456789"):
        _ = header.is_old


def test_every_page_with_tables_says_what_it_measures():
    assert {page.stem for page in ages.PAGES.glob("*.md")} == set(ages.MEASURED)
    for paths in ages.MEASURED.values():
        assert all((ages.ROOT / path).exists() for path in paths)


def test_every_table_that_is_older_than_its_code_says_so():
    try:
        wrong = [f"{header.page.name}: {header.right}" for header in ages.headers() if header.right != header.text]
    except LookupError as error:
        pytest.skip(f"a checkout without its history: {error}")
    assert not wrong, "run python -m validation.ages --write"
