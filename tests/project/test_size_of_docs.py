"""The pages are for a reader: together they take an evening, and each subject has a picture."""

import re

import pytest

from tests._project import ROOT

MAX_WORDS = 20_000
PAGES = [
    page for page in sorted((ROOT / "docs").rglob("*.md")) if page.parent.name != "gallery" or page.stem == "index"
]
WITH_PICTURE = [page for page in PAGES if page.parent.name in ("method", "validation")]


def words(text: str) -> int:
    """The words of a page that a person reads: without code, addresses, and the lines that say how a table was made."""
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    return len(re.sub(r"^\*`.*$|<!--.*?-->|\]\([^)]*\)", "", prose, flags=re.MULTILINE).split())


def test_pages_have_at_most_so_many_words_together():
    assert sum(words(page.read_text("utf-8")) for page in PAGES) <= MAX_WORDS


@pytest.mark.parametrize("page", WITH_PICTURE, ids=lambda page: page.stem)
def test_method_and_validation_pages_show_a_picture(page):
    assert re.search(r"!\[[^\]]{20,}\]\([^)]+\)", page.read_text("utf-8"))


def test_words_of_code_and_addresses_do_not_count():
    code, origin = "```python\nfit(x)\n```", "*`python -m a`, commit 1, 2026*\n<!-- end -->"
    assert words(f"Three [short words](https://a.b/c).\n\n{code}\n\n{origin}\n") == 3
