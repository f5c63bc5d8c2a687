"""Notes that the code cites are pages of the documentation, and the sections that it names are headings there."""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(
    path
    for folder, ending in (("taichi_sand", "py"), ("tests", "py"), ("examples", "*"), ("docs", "py"), ("scenes", "toml"))
    for path in (ROOT / folder).rglob(f"*.{ending}")
)
TOKEN = r"(?:[ABCD]\d+(?:\s?[-–]\s?[ABCD]?\d+)?|[ABCD](?![\w'])|\d+|units|common gates)"
CITATION = re.compile(rf"\b([\w-]+)\.md\b(?!\.\w)((?:(?:,? and |, | )(?:sections? )?{TOKEN})*)")


def citations(text: str) -> list[tuple[str, list[str]]]:
    """Pages that a text cites, each with the sections that it names: A5-A7 are three."""
    found = []
    for page, tail in CITATION.findall(re.sub(r"\s+", " ", text)):
        sections: list[str] = []
        for token in re.findall(TOKEN, tail):
            many = re.fullmatch(r"([ABCD])(\d+)\s?[-–]\s?[ABCD]?(\d+)", token)
            sections += [f"{many[1]}{k}" for k in range(int(many[2]), int(many[3]) + 1)] if many else [token]
        found.append((page, sections))
    return found


@cache
def headings(page: str) -> list[str]:
    """All headings of a page, in small letters; none if there is no such page."""
    paths = [*(ROOT / "docs").rglob(f"{page}.md"), *ROOT.glob(f"{page}.md")]
    return [line.lower() for path in paths for line in re.findall(r"^#+ (.+)$", path.read_text("utf-8"), re.MULTILINE)]


def resolves(page: str, section: str) -> bool:
    """Whether a page has a heading that starts with this section."""
    return any(re.match(rf"{re.escape(section.lower())}(?!\w)", heading) for heading in headings(page))


def test_what_a_citation_is() -> None:
    assert citations("as in physics.md A5-A7 and A10. Every") == [("physics", ["A5", "A6", "A7", "A10"])]
    assert citations("(physics.md,\n    sections A and B); design.md section 6, plain") == [("physics", ["A", "B"]), ("design", ["6"])]
    assert citations("look.md, and colour maps") == [("look", [])]


@pytest.mark.parametrize("path", [path for path in SOURCES if ".md" in path.read_text("utf-8")], ids=lambda path: path.name)
def test_citations_resolve(path: Path) -> None:
    for page, sections in citations(path.read_text("utf-8")):
        if path == Path(__file__) or page == "NAME":
            continue
        assert headings(page), f"{path.name} cites {page}.md, which is not there"
        for section in sections:
            assert resolves(page, section), f"{path.name} cites {page}.md {section}, which has no such heading"


def test_there_are_citations_to_resolve() -> None:
    found = [one for path in SOURCES for one in citations(path.read_text("utf-8"))]
    assert len([one for one in found if one[0] == "physics" and one[1]]) > 40
    assert not resolves("physics", "A17") and not resolves("physics", "A1000")
