"""Writes those parts of the pages that come from the code: tables of keys, options, effects, cases, signatures.

`python docs/generate.py` brings all pages up to date; with `--check` it only says which are not, and exits with 1. What stands in a
page between `<!-- generated: NAME -->` and `<!-- end: NAME -->` is replaced by what the part NAME of PARTS returns; the rest is prose.
"""

import argparse
import importlib
import inspect
import re
import sys
import types
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import annotated_types
import typer
from pydantic import BaseModel

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"(<!-- generated: ([\w-]+) -->\n)(.*?)(<!-- end: \2 -->)", re.DOTALL)


def code(value: Any) -> str:
    """A value as code, or "" if there is none."""
    return f"`{value}`" if value not in (None, "") else ""


def cell(text: str) -> str:
    """Text that may stand in a table."""
    return " ".join(text.split()).replace("|", "\\|")


def table(*head: str, rows: list[tuple[str, ...]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(map(cell, row)) + " |" for row in rows)])


def first_line(thing: Any) -> str:
    """What a docstring says first."""
    return (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")


def unit(text: str) -> str:
    """A unit as it is read: `m/s2` is m/s²."""
    return re.sub(r"(?<=[a-z)])2\b", "²", text)


# Scene files


def heading(name: str, kind: type) -> str:
    """How a table of a scene file is written."""
    from taichi_sand.scene.schema import Edges, EdgeSpeeds, Record, Rock, Scene, Shake, Sizes, Solver, View

    singles = {Edges: "`edges`", Solver: "`[solver]`", View: "`[view]`", Record: "`[record]`", Shake: "`shake`", Sizes: "`radius`"}
    singles |= {Rock: "`rock`", EdgeSpeeds: "`edges.surface_velocity`"}
    return "The scene itself" if kind is Scene else singles.get(kind, f"`[[{name}]]`")


def default_of(field: Any) -> str:
    """The default of a key, as a scene file has it; "required" if there is none."""
    value = field.get_default(call_default_factory=True)
    if field.is_required():
        return "required"
    if value is None or isinstance(value, dict) or isinstance(value, BaseModel) or value == ():
        return ""
    words = {True: "true", False: "false"}
    if isinstance(value, bool):
        return code(words[value])
    if isinstance(value, tuple):
        return code(f"[{', '.join(f'{v:g}' for v in value)}]")
    return code(f'"{value}"' if isinstance(value, str) else f"{value:g}")


def limits_of(field: Any) -> str:
    """What a key may be: its words, or its range."""
    words = [str(arg) for arg in literals(field.annotation)]
    if words:
        return ", ".join(code(word) for word in words)
    found = {}
    for limit in field.metadata:
        for sign, kind in ((">", annotated_types.Gt), ("≥", annotated_types.Ge), ("<", annotated_types.Lt), ("≤", annotated_types.Le)):
            if isinstance(limit, kind):
                found[sign] = f"{next(iter(vars_of(limit).values())):g}"
    return ", ".join(f"{sign} {value}" for sign, value in found.items())


def vars_of(limit: Any) -> dict[str, float]:
    """The one number of a limit, by its name."""
    name = type(limit).__name__.lower()
    return {name: getattr(limit, name)}


def literals(annotation: Any) -> Iterator[Any]:
    """The words that a type allows, within unions."""
    if typing.get_origin(annotation) is typing.Literal:
        yield from typing.get_args(annotation)
    elif typing.get_origin(annotation) in (typing.Union, types.UnionType):
        for part in typing.get_args(annotation):
            yield from literals(part)


def scene_keys() -> str:
    """Every table of a scene file with its keys."""
    from taichi_sand.scene import schema

    parts = []
    for name, kind in schema._tables().items():
        rows = []
        for key, field in kind.model_fields.items():
            extra = (field.json_schema_extra or {}).get("unit", "")
            rows.append((code(key), unit(extra), default_of(field), limits_of(field), field.description or ""))
        parts += [
            f"## {heading(name, kind)}",
            inspect.getdoc(kind).split("\n\nRaises")[0],
            table("key", "unit", "default", "allowed", "", rows=rows),
        ]
    return "\n\n".join(parts)


# Effects


def effect_tables() -> str:
    """Every effect: what it is, its parameters, the solvers it fits."""
    from taichi_sand import effects

    parts = []
    for name in effects.names():
        effect = effects.find(name)
        text = linked("\n\n".join(" ".join(part.split()) for part in effects.about(name).split("\n\n")))
        rows = []
        for p in effect.parameters:
            low, high = (f"{limit:g}" if limit is not None else "" for limit in (p.low, p.high))
            allowed = ", ".join(code(choice) for choice in p.choices) if p.choices else f"{low} … {high}"
            default = f"{p.default:g}" if isinstance(p.default, float) else p.default
            rows.append((code(p.name), unit(p.unit), code(default), allowed, "yes" if p.live else "no", p.help))
        fits = " and ".join(f"`{kind}`" for kind in effect.solvers)
        parts += [f"## `{name}`", f"Solvers: {fits}.", text]
        parts += [table("parameter", "unit", "default", "allowed", "live", "", rows=rows)]
    return "\n\n".join(parts)


def linked(text: str) -> str:
    """A text of a page in reference/ whose citations of the case book are links."""
    known = headings()

    def link(found: re.Match) -> str:
        name = re.sub(r"[^\w\s-]", "", f"{found[1]} {known[found[1]]}").lower().replace(" ", "-")
        return f"[{found[0]}](../physics.md#{name})"

    return re.sub(r"physics\.md ([ABCD]\d+)", lambda found: link(found) if found[1] in known else found[0], text)


def hooks() -> str:
    """What an effect may do, by the solver that calls it."""
    from taichi_sand.effects import HOOKS

    rows = [(code(name), who, text) for who, those in HOOKS.items() for name, text in those.items()]
    return table("hook", "solver", "arguments, and what it returns", rows=rows)


# Commands


def commands() -> str:
    """Every command with its arguments and options, from the signatures of the program."""
    from taichi_sand.cli.main import app

    parts = []
    for info in app.registered_commands:
        call = info.callback
        name = info.name or call.__name__.replace("_", "-")
        rows, places = [], []
        for parameter in inspect.signature(call).parameters.values():
            base, about = typing.get_args(parameter.annotation)[:2]
            given = parameter.default not in (None, False, "", inspect.Parameter.empty)
            if isinstance(about, typer.models.ArgumentInfo):
                place = about.metavar or parameter.name.upper()
                places.append(f"[{place}]" if parameter.default is None else place)
                rows.append((code(place), "", about.help or ""))
                continue
            words = [word for word in (about.default, *about.param_decls) if isinstance(word, str) and word.startswith("-")]
            allowed = "|".join(map(str, literals(base)))
            value = "" if bool in (base, *typing.get_args(base)) else about.metavar or allowed or parameter.name.upper()
            flag = " ".join([", ".join(map(code, words)), code(value)]).strip()
            rows.append((flag, code(parameter.default) if given else "", about.help or ""))
        parts += [f"## `taichi-sand {name}`", first_line(call), f"`taichi-sand {' '.join([name, *places, '[OPTIONS]'])}`"]
        parts += [table("", "default", "", rows=rows)] if rows else []
    return "\n\n".join(parts)


# Python


def python_api() -> str:
    """Signatures and docstrings of what `import taichi_sand` offers."""
    import taichi_sand

    parts = []
    for name in ("load", "Scene", "Simulation", "SandError", "PhysicsError"):
        thing = getattr(taichi_sand, name)
        if isinstance(thing, type):
            parts += [f"## `{name}`", signature_of(name, thing), docstring(thing), *members(thing)]
        else:
            parts += [f"## `{name}`", signature_of(name, thing), docstring(thing)]
    return "\n\n".join(part for part in parts if part)


def members(kind: type) -> Iterator[str]:
    """The public methods and properties of a class and of those of its bases that are ours, in the order of the sources."""
    mine = [base for base in kind.__mro__ if base.__module__.startswith("taichi_sand")]
    seen: set[str] = set()
    for base in mine:
        for name, member in vars(base).items():
            plain = member.__func__ if isinstance(member, classmethod | staticmethod) else member
            wanted = isinstance(plain, property) or inspect.isfunction(plain)
            if name.startswith("_") or name in seen or not wanted or not inspect.getdoc(plain):
                continue
            seen.add(name)
            if isinstance(plain, property):
                returns = inspect.signature(plain.fget).return_annotation
                yield f"### `{kind.__name__}.{name}` → `{type_name(returns)}`"
            else:
                yield f"### `{kind.__name__}.{name}`"
                yield signature_of(name, plain)
            yield docstring(plain)


def type_name(kind: Any) -> str:
    """A type as it is written in the sources."""
    if isinstance(kind, str):
        return kind
    text = kind.__name__ if isinstance(kind, type) and not typing.get_args(kind) else str(kind)
    return re.sub(r"\b(?:[a-z_]\w*\.)+(?=[A-Za-z])", "", text)


def signature_of(name: str, thing: Any) -> str:
    """A signature as a block of Python, one parameter a line if it is long."""
    try:
        signature = inspect.signature(thing.__init__ if isinstance(thing, type) else thing)
    except ValueError:
        return ""
    plain = [p for p in signature.parameters.values() if p.name not in ("self", "cls")]
    if issubclass(thing, BaseException) if isinstance(thing, type) else False:
        return ""
    words = []
    for p in plain:
        star = {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "")
        if p.kind == p.KEYWORD_ONLY and "*" not in words and not any(word.startswith("*") for word in words):
            words.append("*")
        kind = "" if p.annotation is p.empty else f": {type_name(p.annotation)}"
        default = "" if p.default is p.empty else f" = {p.default!r}" if kind else f"={p.default!r}"
        words.append(f"{star}{p.name}{kind}{default}")
    back = (
        "" if isinstance(thing, type) or signature.return_annotation is signature.empty else f" -> {type_name(signature.return_annotation)}"
    )
    line = f"{name}({', '.join(words)}){back}"
    if len(line) > 100:
        line = f"{name}(\n" + "".join(f"    {word},\n" for word in words) + f"){back}"
    return f"```text\n{line}\n```"


def docstring(thing: Any) -> str:
    """A docstring in Markdown: its sections (Args, Returns, Raises) become lists."""
    text = inspect.getdoc(thing) or ""
    out: list[str] = []
    for line in text.splitlines():
        section = re.fullmatch(r"(Args|Returns|Raises):", line)
        entry = re.fullmatch(r"    (\w+): (.*)", line)
        if section:
            out += ["", f"{section[1].replace('Args', 'Arguments')}:", ""]
        elif entry:
            out.append(f"- `{entry[1]}`: {entry[2]}")
        elif line.startswith("        ") and out and out[-1].startswith("- "):
            out[-1] += " " + line.strip()
        elif line.startswith("    ") and out and out[-1] == "":
            out.append(f"- {line.strip()}")
        else:
            out.append(line)
    return re.sub(r"\n{3,}", "\n\n", "\n".join(out)).strip()


# Reports


def report_keys() -> str:
    """Every number of a report: what the head of measure.report says of it, or else its name in the printed table."""
    from taichi_sand.cli.printing import GROUPS

    report = importlib.import_module("taichi_sand.measure.report")

    labels = {key: both for keys in GROUPS.values() for key, both in keys.items()}
    said = report_definitions(report.__doc__ or "")
    rows = [(code(key), unit(labels.get(key, ("", ""))[1]), said.get(key) or labels[key][0]) for key in dict.fromkeys([*labels, *said])]
    return table("key", "unit", "", rows=rows)


def report_definitions(text: str) -> dict[str, str]:
    """The definitions in a docstring: lines that start with names in backquotes and a colon, and what follows them."""
    found: dict[str, str] = {}
    names: list[str] = []
    for line in text.splitlines():
        start = re.match(r"((?:`\w+`(?:, | and )?)+): (.*)", line)
        if start:
            names = re.findall(r"`(\w+)`", start[1])
            found |= dict.fromkeys(names, start[2])
        elif names and line.strip() and not re.match(r"[A-Z]\w+ (are|is) ", line):
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
        else:
            names = []
    return found


# The window


def window_keys() -> str:
    """Keys of the window, by group."""
    from taichi_sand.play.keys import table as keys

    return keys()


def window_tools() -> str:
    """Tools of the mouse, with what the right button does and which numbers of the brush they use."""
    from taichi_sand.play.tools import TOOLS

    rows = [
        (code(tool.key), tool.name, re.sub(r" \(right button.*\)", "", tool.help), tool.inverse, ", ".join(tool.uses))
        for tool in TOOLS.values()
    ]
    return table("key", "tool", "left button", "right button", "brush", rows=rows)


def window_knobs() -> str:
    """Numbers that have a slider: those of the solver and gravity, and the live parameters of effects."""
    import taichi_sand
    from taichi_sand import effects
    from taichi_sand.play.knobs import knobs_of

    rows: dict[str, tuple[str, ...]] = {}
    for kind in ("rigid", "md"):
        solver = {"kind": kind, **({"hertz": 60.0} if kind == "rigid" else {"stiffness": 1e4})}
        chosen = {name: {} for name in effects.fitting(kind) if name not in effects.own and name != "safe_direction"}
        scene = taichi_sand.Scene(size=[1, 1], solver=solver, effects=chosen)
        for knob in knobs_of(scene, scene):
            free = knob.key in ("solver.hertz", "solver.stiffness")
            span = "0.1 … 10 times what the scene gives" if free else f"{knob.low:g} … {knob.high:g}"
            wide = f"{knob.wide[0]:g} … {knob.wide[1]:g}" if knob.wide else ""
            rows.setdefault(knob.key, (code(knob.label if knob.group == "world" else knob.key), unit(knob.unit), span, wide, knob.help))
    return table("number", "unit", "slider", "opened with `u`", "", rows=list(rows.values()))


# Studies


def hard_cases() -> str:
    """The hard cases, with the case of the case book that each is."""
    from taichi_sand.study.stress import stress

    rows = []
    for case in stress.CASES.values():
        found = re.fullmatch(r"(.*?)(?: \(([A-Z]\d+(?:, [A-Z]\d+)*)\))?", case.setup)
        rows.append((code(case.name), found[2] or "", found[1], "yes" if case.quick else "no"))
    return table("case", "case book", "set-up", "with `--quick`", rows=rows)


def validation() -> str:
    """The rows of `taichi-sand validate`."""
    from taichi_sand.study.validate.cases import CASES

    rows = [
        (case.name, first_line(case.rows), case.source, ", ".join(code(k) for k in case.kinds), "yes" if case.quick else "no")
        for case in CASES
    ]
    return table("case", "what is done", "source", "solvers", "with `--quick`", rows=rows)


CITED = re.compile(r"\b([ABCD])(\d+)(?:\s?[-–…]\s?\1?(\d+))?\b")


def cited(text: str) -> set[str]:
    """The cases of the case book that a text names: A5, A5-A7."""
    found = set()
    for letter, low, high in CITED.findall(text):
        found |= {f"{letter}{k}" for k in range(int(low), int(high or low) + 1)}
    return found


def headings() -> dict[str, str]:
    """The cases of the case book, by number."""
    return dict(re.findall(r"^### ([ABCD]\d+) (.+)$", (DOCS / "physics.md").read_text("utf-8"), re.MULTILINE))


def law_tests() -> str:
    """Every case of the book with the tests, rows of `validate` and hard cases that hold the solvers to it."""
    from taichi_sand.study.stress import stress
    from taichi_sand.study.validate.cases import CASES

    known = headings()
    found: dict[str, dict[str, set[str]]] = {number: {"tests": set(), "validate": set(), "stress": set()} for number in known}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        text = path.read_text("utf-8")
        for number in cited(" ".join(docstrings(text))) & set(known):
            found[number]["tests"].add(code(path.relative_to(ROOT / "tests").as_posix()))
    for case in CASES:
        for number in cited(case.name) & set(known):
            found[number]["validate"].add("yes")
    for hard in stress.CASES.values():
        for number in cited(hard.setup) & set(known):
            found[number]["stress"].add(code(hard.name))
    rows = []
    for number, name in known.items():
        by = found[number]
        if any(by.values()):
            rows.append((number, name, ", ".join(sorted(by["tests"])), "".join(by["validate"]), ", ".join(sorted(by["stress"]))))
    return table("case", "law", "tests", "`validate`", "`stress`", rows=rows)


def docstrings(text: str) -> Iterator[str]:
    """All docstrings of a file."""
    import ast

    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef):
            yield ast.get_docstring(node) or ""


PARTS: dict[str, Callable[[], str]] = {
    "scene": scene_keys,
    "effects": effect_tables,
    "hooks": hooks,
    "commands": commands,
    "python": python_api,
    "report": report_keys,
    "keys": window_keys,
    "tools": window_tools,
    "sliders": window_knobs,
    "hard-cases": hard_cases,
    "validation": validation,
    "law-tests": law_tests,
}


def renewed(text: str) -> str:
    """A page with its generated parts as they are now."""
    return BLOCK.sub(lambda found: f"{found[1]}\n{PARTS[found[2]]()}\n\n{found[4]}", text)


def stale(write: bool) -> list[Path]:
    """The pages that are not up to date; brought up to date with `write`."""
    old = []
    for path in sorted(DOCS.rglob("*.md")):
        text = path.read_text("utf-8")
        new = renewed(text)
        if new != text:
            old.append(path.relative_to(ROOT))
            if write:
                path.write_text(new, "utf-8")
    return old


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Brings the generated parts of the pages up to date.")
    parser.add_argument("--check", action="store_true", help="only says which pages are not; exit status 1 if there are any")
    found = stale(write=not (check := parser.parse_args().check))
    for path in found:
        print(f"{path}: {'is not up to date; run python docs/generate.py' if check else 'brought up to date'}")
    return int(check and bool(found))


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
