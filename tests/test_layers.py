"""The plan of the house: who may import whom, and how long files and functions may be."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "taichi_sand"
FILES = sorted(PACKAGE.rglob("*.py"))
RANK = {
    **{"files": 0, "scene": 0, "world": 1, "effects": 2, "solvers": 2},
    **dict.fromkeys(("belief", "clock", "entry", "growing", "host", "live", "readings", "keeping"), 3),
    **dict.fromkeys(("looking", "tuning", "marching", "simulation"), 3),
    **{
        "measure": 4,
        "view": 5,
        "play": 6,
        "study": 6,
        "printing": 7,
        "leaving": 7,
        "cli": 7,
        "cli_study": 7,
        "cli_sweep": 7,
        "cli_options": 7,
    },
    **{"__main__": 8, "fuzz": 8, "tampering": 8},
}
"""Layers from the ground up; a module imports from its own layer or from below."""
LATE = {("readings", "measure"), ("readings", "view")}
"""Upward imports that are allowed inside a function: the face of the package hands its methods on."""
LONGEST_FILE, LONGEST_FUNCTION = 330, 45


def layer(path: Path) -> str:
    part = path.relative_to(PACKAGE).parts[0]
    return part.removesuffix(".py")


def imports(path: Path) -> list[tuple[str, bool]]:
    """Parts of this package that a file imports, each with whether that happens when the file itself is imported."""
    tree = ast.parse(path.read_text("utf-8"))
    inside = {node for function in ast.walk(tree) if isinstance(function, ast.FunctionDef) for node in ast.walk(function)}
    typing = {
        node for test in ast.walk(tree) if isinstance(test, ast.If) and "TYPE_CHECKING" in ast.dump(test.test) for node in ast.walk(test)
    }
    found = []
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "taichi_sand" and len(parts) > 1 and parts[1] in RANK and node not in typing:
                found.append((parts[1], node not in inside))
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_downwards(path: Path) -> None:
    here = layer(path)
    if path == PACKAGE / "__init__.py":  # the public face: nothing at import, everything on demand
        assert not [name for name, early in imports(path) if early]
        return
    for name, early in imports(path):
        if not early and (here, name) in LATE:
            continue
        assert RANK[name] <= RANK[here], f"{path.name} ({here}) imports {name}, which stands above it"
        assert {here, name} != {"effects", "solvers"}, "effects and solvers never import each other"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_files_and_functions_stay_short(path: Path) -> None:
    text = path.read_text("utf-8")
    assert len(text.splitlines()) <= LONGEST_FILE
    lines = text.splitlines()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            doc = node.body[0].end_lineno or 0 if ast.get_docstring(node) else node.lineno
            code = [line for line in lines[doc : node.end_lineno] if line.strip()]
            assert len(code) <= LONGEST_FUNCTION, f"{path.name}: {node.name} has {len(code)} lines"


def test_kernels_see_their_annotations() -> None:
    for path in FILES:
        text = path.read_text("utf-8")
        if "@ti.kernel" in text or "@ti.func" in text:
            assert "from __future__ import annotations" not in text, f"{path.name}: Taichi would see strings"


def test_scenes_and_files_know_no_taichi() -> None:
    for path in (*(PACKAGE / "scene").glob("*.py"), *(PACKAGE / "files").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            assert not any(name.split(".")[0] == "taichi" for name in [*names, module]), path.name


def test_modules_and_public_functions_have_docstrings() -> None:
    for path in FILES:
        tree = ast.parse(path.read_text("utf-8"))
        assert ast.get_docstring(tree), f"{path}: says nothing about itself"
        for node in tree.body:
            kernel = isinstance(node, ast.FunctionDef) and any("ti." in ast.unparse(item) for item in node.decorator_list)
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_") and not kernel:
                assert ast.get_docstring(node), f"{path.name}: {node.name} has no docstring"
