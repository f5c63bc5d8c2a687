"""The tables [[events]]: stages of an experiment. Each comes once: at a time, when the grains have come to rest, or after another one.

What an event does to walls is worked out here, on their tables, in the order in which events stand: by the check of a scene, by who makes
room for all walls that there will be, and when it comes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, ValidationError, model_validator

from taichi_sand.errors import SandError, Wrong, show, suggest
from taichi_sand.scene import moving
from taichi_sand.scene.kinds import Name, Number, Switch, Table, key
from taichi_sand.scene.walls import Rock, Shake, Wall
from taichi_sand.scene.wording import in_words

FIXED = ("name", "points", "closed")
"""Keys of a wall that events cannot set."""
DEPTHS = {"solver": 1, "effects": 2, "walls": 2}
"""How many names follow each head of a key that may be set, but for those of vectors and tables; written without quotes they nest."""
RESERVED = ("end", "rest")


class After(Table):
    """A moment some time after another event."""

    after: str = key(..., "name of an event that stands before this one")
    seconds: Number = key(0.0, "how long after it", "s", ge=0)


def _is_time(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf


def _as_moment(value: Any) -> Any:
    if value == "rest" or _is_time(value) or isinstance(value, After):
        return value
    if isinstance(value, dict) and {"after"} <= set(value) <= {"after", "seconds"} and isinstance(value["after"], str):
        if _is_time(value.get("seconds", 0.0)):
            return After(**value)
    raise ValueError('must be a time in seconds, "rest", or { after = "NAME of an event", seconds = 1.0 }')


def _as_changes(value: Any) -> Any:
    """Dotted keys, whether they were written with quotes or without."""
    if not isinstance(value, dict):
        raise ValueError('must be a table of keys in quotes and values, such as { "effects.friction.mu" = 0.2 }')
    return dict(_flat(value, DEPTHS))


def _flat(table: dict[str, Any], depths: dict[str, int]) -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        depth = depths.get(name, 0)
        if depth and isinstance(value, dict):
            yield from ((f"{name}.{rest}", inner) for rest, inner in _flat(value, dict.fromkeys(value, depth - 1)))
        else:
            yield name, value


Moment = Annotated[float | str | After, BeforeValidator(_as_moment)]
Changes = Annotated[dict[str, Any], BeforeValidator(_as_changes)]


class Event(Table):
    """A stage of an experiment: when it comes, and what changes then. Events stand in the order of their times."""

    name: Name = key("", "what the report, [[checks]] and other events call it; events[k] if not given")
    at: Moment = key(
        ...,
        'when: a time, "rest" (mean speed below 1e-3 √(g d) for 0.2 s, once those before it have come), or { after = NAME, seconds = … }',
        "s",
    )
    set: Changes = key({}, 'live keys and their new values, and of named walls all but `points`: { "walls.lid.velocity" = [0.0, -0.1] }')
    remove_walls: tuple[str, ...] = key((), "names of walls that go")
    start_sources: tuple[str, ...] = key((), "names of [[sources]] that begin to make grains")
    end_sources: tuple[str, ...] = key((), "names of [[sources]] that make no more")
    stop: Switch = key(False, "ends the simulation")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.name in RESERVED:
            raise Wrong("name", f" = {show(self.name)} is a moment that there is anyway; call it otherwise")
        for name in self.start_sources:
            if name in self.end_sources:
                raise Wrong("start_sources", f" and `end_sources` both name {show(name)}")
        for name in self.remove_walls:
            if any(split(key)[0] == name for key in self.set if key.startswith("walls.")):
                raise Wrong("remove_walls", f" names {show(name)}, which `set` changes: it is one or the other")
        return self


def names(events: Sequence[Event]) -> list[str]:
    """What each of these events is called."""
    return [event.name or f"events[{number}]" for number, event in enumerate(events)]


def split(key: str) -> tuple[str, str]:
    """Name of the wall and the rest of a key walls.NAME.KEY."""
    _, name, rest = [*key.split(".", 2), "", ""][:3]
    return name, rest


def wall_changes(event: Event) -> dict[str, dict[str, Any]]:
    """What an event sets of walls: by name, the values by key."""
    found: dict[str, dict[str, Any]] = {}
    for key_, value in event.set.items():
        if key_.startswith("walls."):
            name, rest = split(key_)
            found.setdefault(name, {})[rest] = value
    return found


def live_changes(event: Event) -> dict[str, Any]:
    """What an event sets of live numbers."""
    return {key_: value for key_, value in event.set.items() if not key_.startswith("walls.")}


def onward(wall: Wall, changes: dict[str, Any], time: float) -> Wall:
    """The wall with other values of some of its keys, when its clock shows `time` [s]: if it moves otherwise then, from where it is now on.

    Raises:
        ValidationError: it cannot be such a wall.
    """
    table: dict[str, Any] = wall.model_dump(exclude_unset=True)
    for name, value in changes.items():
        head, _, part = name.partition(".")
        table[head] = {**(table.get(head) or {}), part: value} if part else value
    if not table.get("spin") and not table.get("rock") and "pivot" not in changes:
        table.pop("pivot", None)
    new = Wall(**table)
    if moving.motion(new) == moving.motion(wall) or not moving.moves(wall):
        return new
    points = moving.corners(wall, time)
    table["points"] = (points[:-1] if wall.closed else points).tolist()
    if moving.turns(new) and "pivot" not in changes:
        table["pivot"] = moving.pivot_at(wall, time).tolist()
    return Wall(**table)


def staged(walls: Sequence[Wall], event: Event, times: Sequence[float] | None = None) -> tuple[Wall, ...]:
    """The walls after an event, if their clocks show `times` [s] then (0 if not given); what it says of others is no matter."""
    changes, hours = wall_changes(event), times or [0.0] * len(walls)
    left = [(wall, hour) for wall, hour in zip(walls, hours, strict=True) if not wall.name or wall.name not in event.remove_walls]
    return tuple(onward(wall, changes[wall.name], hour) if wall.name and wall.name in changes else wall for wall, hour in left)


def all_walls(walls: Sequence[Wall], events: Sequence[Event]) -> tuple[Wall, ...]:
    """These walls, and after them all others that events will make of them."""
    found, now = list(walls), tuple(walls)
    for event in events:
        now = staged(now, event)
        found += [wall for wall in now if wall not in found]
    return tuple(found)


@dataclass
class _Course:
    """What is so after the events that have been looked at."""

    walls: tuple[Wall, ...]
    gone: dict[str, str]  # walls that were removed, and by which event
    running: dict[str, bool]  # sources that have a name
    waits: set[str] = field(default_factory=set)  # for an event that starts them


def check_events(scene: Any) -> None:
    """Wrong unless all that the events of `scene` name is there when they come, in the order in which they stand."""
    known = names(scene.events)
    for number, check in enumerate(scene.checks):
        if isinstance(check.at, str) and check.at not in ("end", *known):
            others = f", or the name of an event: {', '.join(known)}{suggest(check.at, known)}" if known else ""
            raise Wrong(f"checks[{number}].at", f' = {show(check.at)} must be a time in seconds, or "end"{others}')
    course = _Course(scene.walls, {}, {source.name: source.name not in waiting(scene) for source in scene.sources if source.name})
    last = 0.0
    for number, event in enumerate(scene.events):
        where = f"events[{number}]"
        if known.index(known[number]) < number:
            raise Wrong(f"{where}.name", f" = {show(known[number])} is the name of two events")
        last = _check_time(where, event, known[:number], last)
        _check_sources(where, scene, event, course)
        _check_walls(where, scene, event, course)
        _check_heads(where, scene, event)


def waiting(scene: Any) -> set[str]:
    """Sources that make nothing until an event starts them: those that events start before any ends them."""
    found: set[str] = set()
    ended: set[str] = set()
    for event in scene.events:
        found |= set(event.start_sources) - ended
        ended |= set(event.end_sources)
    return found


def _check_time(where: str, event: Event, before: list[str], last: float) -> float:
    """The latest time [s] that an event up to this one names."""
    if isinstance(event.at, After) and event.at.after not in before:
        known = f"{suggest(event.at.after, before)} (there are: {', '.join(before) or 'none'})"
        raise Wrong(f"{where}.at", f": after = {show(event.at.after)} must be the name of an event that stands before it{known}")
    if not isinstance(event.at, int | float):
        return last
    if event.at < last:
        text = f" = {event.at:g} must be at least {last:g} s, when one before it comes: events stand in the order of their times"
        raise Wrong(f"{where}.at", text)
    return float(event.at)


def _check_sources(where: str, scene: Any, event: Event, course: _Course) -> None:
    for key_, on in (("start_sources", True), ("end_sources", False)):
        for name in getattr(event, key_):
            if name not in course.running:
                known = f"{suggest(name, course.running)} (those with a name: {', '.join(course.running) or 'none'})"
                raise Wrong(f"{where}.{key_}", f" names {show(name)}, which no [[sources]] table has{known}")
            if course.running[name] == on:
                raise Wrong(f"{where}.{key_}", f" names {show(name)}, which {'runs already' if on else 'makes nothing then anyway'}")
            if on and any(source.until is not None for source in scene.sources if source.name == name):
                raise Wrong(f"{where}.{key_}", f" names {show(name)}, which has an `until`: what an event starts, an event ends")
            course.running[name] = on


def _check_walls(where: str, scene: Any, event: Event, course: _Course) -> None:
    """All walls that it names are there, and may become what it makes of them; `course` then has them as they are after it."""
    there = list(dict.fromkeys(wall.name for wall in course.walls if wall.name))
    changes = wall_changes(event)
    for name, key_ in [(name, "remove_walls") for name in event.remove_walls] + [(name, "set") for name in changes]:
        if name in course.gone and name not in there:
            raise Wrong(f"{where}.{key_}", f" names the wall {show(name)}, which {course.gone[name]} has removed")
        if name not in there:
            known = f"{suggest(name, there)} (those with a name: {', '.join(there) or 'none'})"
            raise Wrong(f"{where}.{key_}", f" names {show(name)}, which no [[walls]] table has{known}")
    for name, values in changes.items():
        for key_, value in values.items():
            _check_wall_key(f'{where}.set."walls.{name}.{key_}"', key_, value)
        for wall in course.walls:
            if wall.name == name:
                try:
                    onward(wall, values, 0.0)
                except ValidationError as error:
                    raise Wrong(f"{where}.set", f": of walls.{name}, {in_words(error, {'': Wall, 'shake': Shake, 'rock': Rock})}") from None
    course.walls = staged(course.walls, event)
    if changes and not any(scene.origin):  # a scene with an origin is checked again once it is moved
        try:
            scene.with_walls(course.walls)
        except SandError as error:
            raise Wrong(f"{where}.set", f": with it {error}") from None
    course.gone |= dict.fromkeys(event.remove_walls, event.name or where)


def _check_wall_key(where: str, name: str, value: Any) -> None:
    known = [one for one in Wall.model_fields if one not in FIXED] + [f"shake.{part}" for part in Shake.model_fields]
    known += [f"rock.{part}" for part in Rock.model_fields]
    if name not in known:
        raise Wrong(where, f" = {show(value)} cannot be set{suggest(name, known)} (what can: {', '.join(known)})")


def _check_heads(where: str, scene: Any, event: Event) -> None:
    """Keys that are live are checked with the simulation, which knows the effects; others are told here."""
    for key_, value in live_changes(event).items():
        head, _, rest = key_.partition(".")
        if head not in ("gravity", "solver", "effects", "walls"):
            heads = "gravity, solver.…, effects.… and walls.NAME.…"
            raise Wrong(f"{where}.set", f": {show(key_)} = {show(value)} cannot be set: what can begins with {heads}")
        effect = rest.partition(".")[0]
        if head == "effects" and effect not in scene.effects:
            text = f"; without a table [effects.{effect}]{suggest(effect, scene.effects)} it is not on"
            raise Wrong(f"{where}.set", f": {show(key_)} = {show(value)} cannot be set{text}")
