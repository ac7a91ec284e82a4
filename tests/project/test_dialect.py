"""Plain English in code and pages: patterns that a physicist would not search for, and where they still stand.

A reviewer adds a pattern as one line of ``PATTERNS``, and its places to ``known_dialect.txt``. The list only shrinks: a
new place fails, and so does a line whose place is mended. ``python -m tests.project.test_dialect`` deletes such lines.
"""

import re
from pathlib import Path

import pytest

from tests._project import ROOT, python_files

KNOWN = Path(__file__).parent / "known_dialect.txt"
# name: what stands there, and what to write instead
PATTERNS = {
    "from-where-on": (r"\b(from|beyond) (where|which) on\b", "name the limit: 'above 3 px'"),
    "of-which": (r"\bof which\b", "two sentences, or 'whose'"),
    "is-no": (r"(?<!\b[Tt]here )\b(is|are) no (?!longer\b|more\b|less\b)[a-z]+", "'is not a', or the opposite word"),
    "so-many": (r"\bso (many|much)\b", "the number, or 'too many'"),
    "hardly": (r"\b(hardly|seldom|now and then)\b", "a number, or 'rarely'"),
    "is-said": (r"\b(is|are|was|were) (said|told)\b", "a subject that acts: 'the report states'"),
    "looks": (r"\b(its|their|the|whose) looks\b", "'appearance'"),
    "none-of": (r"\bnone of (a|none)\b", "'not a'"),
    "what-lies": (r"\b(what|whatever) (lies|moves|stands|is behind)\b", "the noun of what it is"),
    "thing": (r"\b([Aa]|[Tt]he|[Aa]nother|[Oo]ther) things?\b", "'object', or the noun of what it is"),
    "asked-for": (r"\b(is|are|was|were|than) asked for\b", "'requested'"),
    "plainly": (r"\bplainly\b", "'clearly'"),
    "there-on": (r"\bfrom (there|then) on\b", "'after it', or the limit"),
    "speaks": (r"\bspeaks? (for|against)\b", "'evidence against'"),
    "of-its-own": (
        r"\b(process(es)?|folders?|files?|tables?|pages?) of (its|their) own\b",
        "'a separate file', 'its file'",
    ),
    "to-be-seen": (r"\bis to be seen\b", "'is visible'"),
    "most-least": (
        r"\b(MOST|LEAST|FEWEST|LARGEST|SMALLEST|LONGEST|SHORTEST)(_[A-Z_]+)?(?= = |, [A-Z_]+ = )",
        "MAX_ or MIN_",
    ),
    "vague-name": (
        r"\b(MOSTLY|ALMOST|NEARLY|OFTEN|SELDOM|FEW|ENOUGH|CLEARLY)(_[A-Z_]+)?(?= = |, [A-Z_]+ = )",
        "the quantity: MIN_SHARE, MAX_BODIES",
    ),
}
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def prose(text: str) -> str:
    """The text in one line, without the tables that programs wrote, which keep the words of their commit."""
    return " ".join(re.sub(r"<!-- table: .*?<!-- end -->", "", text, flags=re.DOTALL).split())


def patterns_in(text: str) -> set[str]:
    """The names of the patterns that stand in a text."""
    line = prose(text)
    return {name for name, (pattern, _) in PATTERNS.items() if re.search(pattern, line)}


def places() -> set[str]:
    """Every pattern with the file in which it stands, as ``name: path``."""
    files = [*python_files(), *(page for page in PAGES if page.parent.name != "gallery" or page.stem == "index")]
    found = {path.relative_to(ROOT).as_posix(): patterns_in(path.read_text("utf-8")) for path in files}
    return {f"{name}: {path}" for path, names in found.items() for name in names}


def known() -> set[str]:
    """The places that were there when their pattern was added."""
    return set(KNOWN.read_text("utf-8").splitlines())


def test_no_new_place_has_a_pattern_of_the_dialect():
    new = sorted(places() - known())
    assert [f"{place}: write {PATTERNS[place.partition(':')[0]][1]}" for place in new] == []


def test_list_of_known_places_only_shrinks():
    mended = sorted(known() - places())
    assert mended == [], "delete these lines: python -m tests.project.test_dialect"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("from-where-on", "px off the outline, from where on\nnothing is asked for"),
        ("of-which", "a share of which no mean is wanted"),
        ("is-no", "an outline that is no streak"),
        ("is-said", "what is cut off is said"),
        ("looks", "a body known by the looks"),
        ("what-lies", "samples that show what is behind"),
        ("thing", "the track is on another thing"),
        ("asked-for", "fewer bodies move than asked for"),
        ("plainly", "the body is plainly visible"),
        ("there-on", "wrong from there on"),
        ("speaks", "what speaks against a track"),
        ("of-its-own", "runs in a process of its own"),
        ("most-least", "MOST_ROWS = 5"),
        ("most-least", "FEWEST = 5"),
        ("most-least", "LARGEST_SHARE = 0.5"),
        ("most-least", "SHORTEST, LONGEST = 4, 9"),
        ("vague-name", "MOSTLY = 0.8"),
    ],
)
def test_pattern_is_found(name, text):
    assert name in patterns_in(text)


@pytest.mark.parametrize(
    "text", ["there is no gap", "it is no longer valid", "MAX_ROWS = 5", "no more than five", "one thing is missing"]
)
def test_plain_words_are_left_alone(text):
    assert patterns_in(text) == set()


if __name__ == "__main__":
    KNOWN.write_text("".join(f"{line}\n" for line in sorted(known() & places())), encoding="utf-8")
