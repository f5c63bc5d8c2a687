"""From a name or a path, and `--set` overrides, to a `Scene`."""

import json
import os
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from taichi_sand.errors import SandError, show, suggest
from taichi_sand.files.reading import read_text, starts_with
from taichi_sand.scene.checks import foreign
from taichi_sand.scene.schema import Scene

KINDS = ("md", "rigid")
MOST_TEXT = 256 * 2**20
"""A scene file with the places of a million grains in it has some 60 MB."""
OTHERS = {
    b"PK\x03\x04": "this is no scene file but looks like a checkpoint; `taichi-sand run --resume FILE` goes on from one",
    b'{"taichi_sand recording"': "this is no scene file but what `play --record` wrote; `taichi-sand render FILE -o OUT` films it",
}
"""What is taken for a scene file, by how it begins."""


def bundled() -> dict[str, Path]:
    """Returns the scenes that come with the package, by name."""
    package = Path(__file__).parents[1]
    folders = (package / "scenes", package.parent / "scenes")  # as installed, as checked out
    folder = next((folder for folder in folders if folder.is_dir()), package)
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def find(name_or_path: str | os.PathLike[str]) -> Path:
    """Returns the file of a scene, given its path or the name of a bundled one; SandError if there is none."""
    if not isinstance(name_or_path, str | os.PathLike):
        raise SandError(f"a scene is read from a path, or by its name, not from {show(name_or_path)}")
    path, known = Path(name_or_path), bundled()
    if path.is_file():
        return path
    if str(name_or_path) in known:
        return known[str(name_or_path)]
    if path.exists():
        raise SandError(f"{path} is {'a folder' if path.is_dir() else 'a pipe, a device or the like'}, not a scene file")
    near = suggest(path.stem, known)
    if path.suffix or len(path.parts) > 1:
        raise SandError(f"{path}: there is no such file{near}")
    raise SandError(f"there is no scene `{name_or_path}`{near} (`taichi-sand scenes` lists those there are; a path works too)")


def read(path: Path) -> dict[str, Any]:
    """Returns the tables of a scene file as they stand there; SandError if it is not UTF-8 text or not TOML."""
    for head, what in OTHERS.items():
        if starts_with(path, head):
            raise SandError(f"{path}: {what}")
    text = read_text(path, "scene file", MOST_TEXT)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a TOMLDecodeError, or a number or nesting without end
        reason = str(error) if isinstance(error, ValueError) else "too deeply nested"
        raise SandError(f"{path.name}: not a scene file, its TOML is wrong: {reason[:200]}") from None


def load(name_or_path: str | os.PathLike[str], overrides: Sequence[str] = (), effects: Sequence[str] = ()) -> Scene:
    """Reads a scene.

    Args:
        name_or_path: a file, or the name of a bundled scene.
        overrides: `KEY=VALUE` each; KEY is a dotted path (`solver.tolerance`, `grains[0].count`, `effects.friction.mu`), VALUE is
            written as in TOML, quotes around a text may be left out. Setting `solver.kind` drops what the file says
            about the other kind.
        effects: names of effects that are on, with their defaults, where the scene does not name them.

    Raises:
        SandError: the file or an override is wrong; the sentence names the file, or `--set`, and the key.
    """
    path = find(name_or_path)
    data = read(path)
    asked = [_parse(override) for override in ([overrides] if isinstance(overrides, str) else overrides)]
    for key, value in asked:
        if key == "solver.kind" and value in KINDS and isinstance(data.get("solver"), dict):
            for name in foreign(value):
                data["solver"].pop(name, None)
    for key, value in asked:
        _put(data, key, value)
    _beside(data, path.parent)
    if effects and isinstance(data.setdefault("effects", {}), dict):
        data["effects"] = {**{name: {} for name in effects}, **data["effects"]}
    try:
        scene = Scene(**data)
    except SandError as error:
        origin = "--set" if any(error.key.startswith(key) for key, _ in asked) else path.name
        raise SandError(f"{origin}: {error}", error.key) from None
    scene._source = path.name
    return scene


def scene_of(thing: Any) -> Scene:
    """The scene that something stands for: a scene itself, or a name or path to `load`; SandError if it is neither."""
    return thing if isinstance(thing, Scene) else load(thing)


def changed(scene: Scene, overrides: Sequence[str]) -> Scene:
    """Returns `scene` with `KEY=VALUE` overrides, as `load` takes them; SandError if one is wrong."""
    data = json.loads(scene.to_json())
    asked = [_parse(override) for override in overrides]
    for key, value in asked:
        _put(data, key, value)
    try:
        made = Scene(**data)
    except SandError as error:
        raise SandError(f"{scene.source or 'scene'}: {error}", error.key) from None
    made._source = scene.source
    return made


def _parse(override: str) -> tuple[str, Any]:
    if not isinstance(override, str):
        raise SandError(f"an override is a text KEY=VALUE, such as solver.tolerance=0.01, not {show(override)}")
    key, equals, value = override.partition("=")
    key = re.sub(r"\.(\d+)(?=\.|$)", r"[\1]", key.strip())
    if not equals or not re.fullmatch(r"\w+(\[\d+\])*(\.\w+(\[\d+\])*)*", key):
        raise SandError(f"--set {show(override)} must read KEY=VALUE, such as --set solver.tolerance=0.01", key)
    return key, _value(value.strip())


def _value(text: str) -> Any:
    try:
        table = tomllib.loads(f"value = {text}")
        if list(table) == ["value"]:
            return table["value"]
    except (ValueError, RecursionError):
        pass
    return float(text) if re.fullmatch(r"[+-]?(\d+\.|\.\d+)(e[+-]?\d+)?", text, re.IGNORECASE) else text


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Writes one override into the tables of a scene, making tables that are not there yet."""
    parts: list[str | int] = [int(part) if part.isdigit() else part for part in re.findall(r"\w+", key)]
    place: Any = data
    for index, part in enumerate(parts):
        if isinstance(part, int) != isinstance(place, list) or not isinstance(place, list | dict):
            raise SandError(f"--set {key}: {_name(parts[:index])} is {_what(place)}", key)
        if isinstance(part, int) and part >= len(place):
            raise SandError(f"--set {key}: {_name(parts[:index])} has {len(place)} entries, 0 is the first", key)
        if index == len(parts) - 1:
            cast(Any, place)[part] = value
        else:
            place = place.setdefault(part, {}) if isinstance(place, dict) else cast(Any, place)[part]


def _name(parts: Sequence[str | int]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).lstrip(".")


def _what(place: Any) -> str:
    if isinstance(place, dict):
        return "a table with named keys, not a list"
    return "a list: give a number, as in grains[0].count" if isinstance(place, list) else "a value without keys of its own"


def _beside(data: dict[str, Any], folder: Path) -> None:
    """Files that a scene names lie beside it."""
    tables = data.get("grains")
    for table in tables if isinstance(tables, list) else ():
        if isinstance(table, dict) and isinstance(table.get("positions_file"), str):
            table["positions_file"] = str(folder / table["positions_file"])
