"""The plan of the house: who may import whom, and how long files and functions may be."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "taichi_sand"
FILES = sorted(PACKAGE.rglob("*.py"))
RANK = {
    **{"errors": 0, "files": 1, "scene": 2, "taichi_support": 3, "world": 4, "effects": 5, "solvers": 5, "measure": 6, "view": 7, "run": 8},
    **{"output": 9, "play": 10, "study": 10, "cli": 11, "__main__": 12},
}
"""Rooms from the ground up; a module imports from its own room or from below."""
MOST_FILES = 12
"""In `world/`, and in each of its rooms."""
LONGEST_FILE, LONGEST_FUNCTION = 330, 45


def layer(path: Path) -> str:
    part = path.relative_to(PACKAGE).parts[0]
    return part.removesuffix(".py")


def imports(path: Path) -> list[tuple[str, bool]]:
    """Modules of this package that a file imports, for types too, each with whether that happens when the file itself is imported."""
    tree = ast.parse(path.read_text("utf-8"))
    inside = {node for function in ast.walk(tree) if isinstance(function, ast.FunctionDef) for node in ast.walk(function)}
    found = []
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            module = next((one for one in (name, name.rpartition(".")[0]) if one in MODULES), None)
            if module and module != "taichi_sand":
                found.append((module, node not in inside))
    return found


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_of(path): path for path in FILES}


def test_the_public_face_imports_nothing() -> None:
    """Taichi takes a second to import, and a scene may only be wanted to be read."""
    code = "import sys, taichi_sand; print([name for name in sys.modules if name.startswith(('taichi', 'numpy'))])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    assert done.stdout == "['taichi_sand']\n"


def test_no_circle_of_imports() -> None:
    """Neither at run time nor for types, among all files of the package but its public face."""
    graph = {name: {other for other, _ in imports(path)} - {name} for name, path in MODULES.items() if name != "taichi_sand"}
    TopologicalSorter(graph).prepare()


def test_rooms_of_the_world_stay_small() -> None:
    for room in (PACKAGE / "world", *(path for path in (PACKAGE / "world").iterdir() if (path / "__init__.py").exists())):
        assert len(list(room.glob("*.py"))) <= MOST_FILES + 1, room.name  # its docstring stands in one more


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_downwards(path: Path) -> None:
    here = layer(path)
    if path == PACKAGE / "__init__.py":  # the public face: everything on demand, see below
        return
    for module, _ in imports(path):
        name = module.split(".")[1]
        assert RANK[name] <= RANK[here], f"{path.name} ({here}) imports {module}, which stands above it"
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


def test_slow_tests_are_there() -> None:
    """What slow.txt names begins the name of a test in a file that exists."""
    for line in (PACKAGE.parent / "tests" / "slow.txt").read_text().splitlines():
        if line.startswith("#"):
            continue
        path, _, name = line.partition("::")
        text = (PACKAGE.parent / path).read_text("utf-8")
        assert f"def {name.partition('[')[0]}" in text, line
