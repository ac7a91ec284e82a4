"""One vocabulary: words that were given up appear neither in code nor in pages; docs/glossary.md has those in use."""

import ast
import re

import pytest

from tests._project import ROOT, python_files

# what was given up: what is written now
OLD_NAMES = {
    "Sighting": "Detection",
    "Glimpse": "FrameDetections",
    "Lens": "BlobDetector or Distortion",
    "Intruder": "EdgeObject",
    "Workshop": "DiscFitter",
    "Lesson": "DiscAppearance",
    "Companion": "CompetingEffect",
    "reservations": "diagnostic_notes",
    "would_take": "rejected_effect_note",
    "error_memory": "error_autocorrelation",
}
OLD_PHRASES = {
    r"\bthe twin\b": "synthetic clips",
    r"\btwin clips?\b": "synthetic clip",
    r"\bif nothing else is lacking\b": "assuming no further missing effect",
    r"\bmore is lacking\b": "the model is still incomplete",
    r"\bsomething is lacking\b": "the model is incomplete",
    r"\bwhat is left would take\b": "the residual fits best with",
    r"\bmemory of (the )?errors\b": "error autocorrelation",
    r"\b(is|as) wild\b": "outlier",
}
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def names_in(tree: ast.AST) -> set[str]:
    """The names that a file defines or uses."""
    defined = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    return (
        defined
        | {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        | {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        | {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    )


@pytest.mark.parametrize("path", python_files(), ids=lambda path: str(path.relative_to(ROOT)))
def test_old_names_are_gone_from_the_code(path):
    old = names_in(ast.parse(path.read_text("utf-8"))) & OLD_NAMES.keys()
    assert {name: f"write {OLD_NAMES[name]}" for name in old} == {}


def prose(text: str) -> str:
    """The text without the tables that programs wrote, which keep the words of their commit."""
    return " ".join(re.sub(r"<!-- table: .*?<!-- end -->", "", text, flags=re.DOTALL).split())


@pytest.mark.parametrize("path", [*python_files(), *PAGES], ids=lambda path: str(path.relative_to(ROOT)))
def test_old_phrases_are_gone(path):
    text = prose(path.read_text("utf-8"))
    assert {old: f"write {new}" for old, new in OLD_PHRASES.items() if re.search(old, text, re.IGNORECASE)} == {}


def test_glossary_has_at_most_sixty_terms_each_with_one_sentence():
    lines = re.findall(r"^\*\*.+$", (ROOT / "docs" / "glossary.md").read_text("utf-8"), re.MULTILINE)
    assert 30 < sum(line.count("**: ") for line in lines) <= 60
    assert all(line.endswith(".") for line in lines)
