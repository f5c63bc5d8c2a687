"""The documentation: it builds, its generated parts are up to date, and every command and every block of Python in it runs.

What a comment before a block does is told in docs/contributing.md.
"""

import ast
import importlib.util
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer.main
from typer.testing import CliRunner

import taichi_sand as sand
from taichi_sand import effects
from taichi_sand.cli.main import app
from taichi_sand.cli.printing import GROUPS
from taichi_sand.scene import loading

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.rglob("*.md")), ROOT / "README.md"]
FENCE = re.compile(r"(?:<!-- test: (?P<note>[^>]*?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"# ([\w-]+\.(?:py|toml))\n")
LANGUAGES = {"python", "sh", "toml", "text"}


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: Path
    line: int
    language: str
    text: str
    note: str

    @property
    def slow(self) -> bool:
        """Whether only the slow tests run it."""
        return self.note == "slow"

    @property
    def runs(self) -> bool:
        """Whether any test runs it."""
        return not self.note.startswith("never, ")

    def commands(self) -> list[list[str]]:
        """Its commands, a list of words each, with the options that the test adds or replaces."""
        found = []
        for line in self.text.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            more = shlex.split(self.note.removeprefix("with ")) if self.note.startswith("with ") else []
            for option, value in zip(more[::2], more[1::2], strict=True):
                if option in words:
                    words[words.index(option) + 1] = value
                else:
                    words += [option, value]
            found += [words] if words else []
        return found


def blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page."""
    text = page.read_text("utf-8")
    found = []
    for match in FENCE.finditer(text):
        line = text.count("\n", 0, match.start("text")) + 1
        found.append(Block(page, line, match["language"], match["text"], match["note"] or ""))
    return found


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The current folder of a page; effects that it brings are forgotten."""
    monkeypatch.chdir(tmp_path)
    before = dict(effects.own)
    yield tmp_path
    effects.own.clear()
    effects.own.update(before)


def run_command(words: list[str], folder: Path) -> None:
    """Runs a command: ours in this process, on one thread as the pages do in Python; Python in one of its own."""
    if words[0] == "taichi-sand":
        command = typer.main.get_command(app).commands[words[1]]
        if any(p.name == "threads" for p in command.params) and "--threads" not in words:
            words = [*words, "--threads", "1"]
        result = CliRunner().invoke(app, words[1:])
        assert result.exit_code == 0, (words, result.output, result.exception)
    else:
        assert words[0] == "python", words
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run([sys.executable, *words[1:]], cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, (words, done.stdout, done.stderr)


def run(block: Block, folder: Path, names: dict[str, Any]) -> None:
    """Runs a block, or writes the file that it is."""
    named = NAMED.match(block.text)
    if named:
        (folder / named[1]).write_text(block.text, "utf-8")
    if block.language == "toml":
        sand.load(folder / named[1]) if named else sand.Scene(**tomllib.loads(block.text))
    elif block.language == "sh":
        for words in block.commands():
            run_command(words, folder)
    elif block.language == "python" and not named:
        exec(compile("\n" * (block.line - 1) + block.text, str(block.page), "exec"), names)


@pytest.mark.parametrize("page", [page for page in PAGES if any(b.runs and not b.slow for b in blocks(page))], ids=name_of)
def test_the_blocks_of_a_page_run(page: Path, folder: Path) -> None:
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks(page):
        assert block.language in LANGUAGES, f"{page.name}:{block.line}: say what language it is"
        if block.runs and not block.slow:
            run(block, folder, names)


SLOW = [block for page in PAGES for block in blocks(page) if block.slow]


def block_name(block: Block) -> str:
    return f"{name_of(block.page)}:{block.line}"


@pytest.mark.slow
@pytest.mark.parametrize("block", SLOW, ids=block_name)
def test_slow_blocks_run(block: Block, folder: Path) -> None:
    run(block, folder, {"__name__": "page"})


@pytest.mark.parametrize("block", SLOW, ids=block_name)
def test_slow_blocks_would_be_understood(block: Block) -> None:
    """Options are known, and the scene takes what is set."""
    for words in block.commands():
        assert words[0] == "taichi-sand"
        command = typer.main.get_command(app).commands[words[1]]
        given = command.make_context(words[1], words[2:]).params
        scene = sand.load(given["scene"], given["overrides"] or ())
        assert scene.title


def spoken(page: Path) -> list[str]:
    """Whole commands in the running text of a page: those without a placeholder in capitals, such as FILE."""
    prose = FENCE.sub("", page.read_text("utf-8"))
    found = [" ".join(text.split()) for text in re.findall(r"`(taichi-sand \w+ [^`]+)`", prose)]
    return [text for text in found if not re.search(r"\b[A-Z]{2,}\b|…", text)]


@pytest.mark.parametrize("page", [page for page in PAGES if spoken(page)], ids=name_of)
def test_commands_in_the_text_would_be_understood(page: Path) -> None:
    for text in spoken(page):
        words = shlex.split(text)
        given = typer.main.get_command(app).commands[words[1]].make_context(words[1], words[2:]).params
        scene = given.get("scene")
        if scene in loading.bundled():
            assert sand.load(scene, given["overrides"] or ()).title
        else:
            assert scene is None or scene.endswith(".toml"), text


def test_what_is_never_run_says_why() -> None:
    for page in PAGES:
        for block in blocks(page):
            assert block.note in ("", "slow") or re.match(r"(with --\w+ \S+|never, \w+ .+)", block.note), (page, block.line, block.note)
    assert sum(not block.runs for page in PAGES for block in blocks(page)) <= 4


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_generated_parts_are_up_to_date() -> None:
    """If this fails: python docs/generate.py"""
    generate = generator()
    assert generate.stale(write=False) == [], "run python docs/generate.py"
    used = set(re.findall(r"<!-- generated: ([\w-]+) -->", "".join(page.read_text("utf-8") for page in PAGES)))
    assert used == set(generate.PARTS), "a part that no page has, or a page that asks for none there is"


def keys_of_reports() -> set[str]:
    """What measure.report gives names to: keys of dictionaries, and of assignments to one."""
    tree = ast.parse((ROOT / "taichi_sand" / "measure" / "report.py").read_text("utf-8"))
    found = {key for node in ast.walk(tree) if isinstance(node, ast.Dict) for key in node.keys}
    found |= {node.slice for node in ast.walk(tree) if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store)}
    return {key.value for key in found if isinstance(key, ast.Constant) and isinstance(key.value, str)}


def test_every_key_of_a_report_is_in_the_reference() -> None:
    text = (DOCS / "reference" / "report.md").read_text("utf-8")
    listed = set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))
    sim = sand.Simulation(sand.Scene(size=[0.1, 0.1], grains=[{"radius": 0.01, "count": 3}]), threads=1)
    assert set(sim.report()) <= keys_of_reports() <= listed
    assert {key for keys in GROUPS.values() for key in keys} <= listed


def test_the_site_builds_without_a_warning_or_a_network(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1", "no_proxy": "*"}
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-f", str(ROOT / "mkdocs.yml"), "-d", str(tmp_path / "site")],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pages = list((tmp_path / "site").rglob("*.html"))
    assert len(pages) >= len(list(DOCS.rglob("*.md")))
    for page in pages:
        fetched = re.findall(
            r'<(?:script|img)[^>]+src="(https?:[^"]+)"|<link[^>]+rel="(?:stylesheet|preconnect)"[^>]+href="(https?:[^"]+)"',
            page.read_text("utf-8"),
        )
        assert not fetched, f"{page.name} fetches {fetched}"
    assert not list((tmp_path / "site").rglob("*.py"))


def test_pictures_that_pages_show_are_there() -> None:
    for page in PAGES:
        for link in re.findall(r"\]\(((?:\.\./)+renders/[\w.-]+)\)", page.read_text("utf-8")):
            assert (page.parent / link).is_file(), f"{page.name}: {link}"
