"""Turns what pydantic found wrong with a scene into one sentence."""

from typing import Any

from pydantic import BaseModel, ValidationError

from taichi_sand.errors import SandError, Wrong, show, suggest

ALLOWED = {
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "int_parsing_size": "must be a whole number of reasonable size",
    "bool_type": "must be true or false",
    "string_type": "must be a text in quotes",
    "finite_number": "must be a finite number",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "model_type": "must be a table with keys of its own",
    "dict_type": "must be a table with keys of its own",
    "string_pattern_mismatch": 'must be a colour like "#2B5DA8"',
}
LISTS = ("shapes", "grains", "walls", "sources", "sinks", "water", "materials", "material_pairs", "events", "checks")
LIMITS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")


def path(location: tuple[int | str, ...]) -> str:
    """Returns a place in the scene as users write it: ("grains", 0, "radius") -> grains[0].radius."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def in_words(error: ValidationError, tables: dict[str, type[BaseModel]]) -> SandError:
    """Returns the first thing wrong as a SandError; unknown keys come first, since they explain what is missing.

    Args:
        error: what pydantic raised for a scene.
        tables: the model of each table by its name in the scene, "" for the scene itself.
    """
    details = sorted(error.errors(include_url=False), key=lambda detail: detail["type"] != "extra_forbidden")
    detail = details[0]
    location = tuple(part for part in detail["loc"] if not str(part).startswith("["))
    if detail["type"] == "json_invalid":
        return SandError(f"this is not the JSON of a scene: {detail['msg']}")
    if detail["type"] == "value_error":
        wrong = detail.get("ctx", {})["error"]
        if isinstance(wrong, Wrong):
            name = ".".join(filter(None, (path(location), wrong.name)))
            return SandError(f"{name}{wrong}", name)
        return SandError(f"{path(location)} = {show(detail['input'])} {wrong}", path(location))
    model = _model(location, tables)
    name = path(location)
    if detail["type"] == "extra_forbidden":
        table = _table_name(location[:-1])
        known = list(model.model_fields)
        return SandError(f"{name} is not a known key{suggest(location[-1], known)} ({table} has {', '.join(known)})", name)
    help_text, unit = _help(model, location)
    if detail["type"] == "missing" and isinstance(location[-1], str):
        return SandError(f"{name} is missing: {help_text}{unit and f' ({unit.strip()})'}", name)
    if detail["type"] == "missing":  # a list that is too short
        location = location[:-1]
        name = path(location)
    wanted = _wanted(detail)
    value = show(detail["input"])
    if wanted:
        return SandError(f"{name} = {value} {wanted}{unit if detail['type'] in LIMITS else ''} ({help_text})", name)
    if name in LISTS:
        return SandError(f"{name} = {value} must be a list of tables, each headed [[{name}]]", name)
    return SandError(f"{name} = {value} must be: {help_text}{unit and f' ({unit.strip()})'}", name)


def _model(location: tuple[int | str, ...], tables: dict[str, type[BaseModel]]) -> type[BaseModel]:
    """The model of the table that the last key of a place belongs to."""
    names = [part for part in location if isinstance(part, str)]
    return next((tables[name] for name in reversed(names[:-1]) if name in tables), tables[""])


def _wanted(detail: Any) -> str:
    if detail["type"] == "literal_error":
        choices = detail["ctx"]["expected"].replace("'", "").replace(" or ", ", ").split(", ")
        return f"must be one of {', '.join(choices)}{suggest(detail['input'], choices) if isinstance(detail['input'], str) else ''}"
    return ALLOWED.get(detail["type"], "").format_map(detail.get("ctx", {}))


def _table_name(location: tuple[int | str, ...]) -> str:
    if not location:
        return "a scene"
    if len(location) > 1 + (location[0] in LISTS):  # a table within one
        return path(location)
    return f"[[{location[0]}]]" if location[0] in LISTS else f"[{location[0]}]"


def _help(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[str, str]:
    """Help and " unit" of the key, or of the table, that a place lies in."""
    for part in reversed(location):
        field = model.model_fields.get(str(part))
        if field is not None:
            extra = field.json_schema_extra
            unit = str(extra["unit"]) if isinstance(extra, dict) else ""
            return field.description or "", f" {unit}" if unit else ""
    return "a table", ""
