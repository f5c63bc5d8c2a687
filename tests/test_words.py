"""The field's words: private ones do not come back, and what the glossary names is where it says."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PRIVATE = re.compile(
    r"\b(running_?sums?|lay_by|naps?|lull|rouse\w*|bury|kits?|shelf|census|spin_cone|search_now|stir_now|guess_impulse)\b", re.I
)
"""Words that nobody else uses for prefix sum, store impulse, sleep state, fall asleep, wake all, field set, field pool, edit, …"""
TERMS = [
    line.strip("| \n").split(" | ") for line in (ROOT / "docs" / "glossary.md").read_text("utf-8").splitlines() if line.startswith("| ")
][1:]


def test_no_private_words() -> None:
    found = []
    for path in sorted((ROOT / "taichi_sand").rglob("*.py")):
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
            found += [f"{path.relative_to(ROOT)}:{number}: {word[0]}" for word in PRIVATE.finditer(line)]
    assert not found


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term[0])
def test_glossary_says_where(term: list[str]) -> None:
    """Three columns, and the place exists."""
    _, meaning, where = term
    assert meaning.strip() and not meaning.endswith(".")
    for place in re.findall(r"`([\w/.]+)`", where):
        assert (ROOT / "taichi_sand" / place).exists(), place
    for page in re.findall(r"\]\(([\w.]+)", where):
        assert (ROOT / "docs" / page).exists(), page
