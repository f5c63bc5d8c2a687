"""A film as a page: one file that plays in a browser, without a server and without a network.

States are kept in groups of frames, each compressed by itself: a page unpacks those that it shows. What stays of the discs is kept once for
all groups that have the same. Within a group places are differences from where the two frames before lead straight on (first differences
take 6 % more), bytes differences from the frame before, high and low bytes apart. Of a film of a flow places are half of all bytes.
"""

import base64
import gzip
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from taichi_sand.files.jsons import finite
from taichi_sand.measure.report import contacts, motion
from taichi_sand.view.planes import ABSENT, Planes, Roster, State, message, scene_of
from taichi_sand.view.style import in_page, page, style
from taichi_sand.view.views import KIND

GROUP = 32
"""Frames of a group: what a jump in time has to unpack at most."""
CHAINS_A_SECOND = 10
"""Contacts are half of all bytes: they come only so often in a second of film."""
LAST_SHADE = 63
"""The highest of the numbers that colours show, and of the forces of contacts: of 256 steps the last two bits are noise that gzip cannot
shorten, a fifth of a film."""
LEVEL = 6
"""Of compression; 9 takes three times as long for 1 % less."""
SHOWN = ("speed", "force", "order", "temperature", "moisture")
"""Views whose numbers are in every film that has them, besides the one that the scene asks for."""
MOTION = ("kinetic_energy_J", "potential_energy_J", "speed_max_m_s", "bed_height_m")
CONTACTS = ("contacts", "overlap_p99", "coordination", "floor_force_N", "wall_force_N")
Write = Callable[..., None]


class Film:
    """Writes the states of a simulation, or of one after another, into a page."""

    def __init__(self, file: IO[str], fps: int) -> None:
        self.file, self.fps = file, fps
        self.stride = max(1, round(fps / CHAINS_A_SECOND))
        self.planes: Planes | None = None
        self.group: list[tuple[State, dict[str, Any]]] = []
        self.scene: dict[str, Any] = {}
        self.series: dict[str, list] = {}
        self.spans: list[tuple[float, float, int]] = []
        self.sim: Any = None
        self.rosters: list[Roster] = []
        self.count = 0

    def begin(self, sim: Any) -> None:
        """The page up to its states."""
        view = sim.scene.view
        head = {"kind": "film", "fps": self.fps, "steps": LAST_SHADE, "style": style(), "scene": scene_of(sim)}
        head |= {"view": view.color, "chains": view.force_chains}
        self.file.write(page()[0].replace("<!-- TITLE -->", plain(sim.scene.title or "taichi_sand")))
        self.file.write(f'<script type="application/json" id="head">{in_page(finite(head))}</script>\n')

    def write(self, sim: Any, at: float | None = None) -> None:
        """A frame: this moment, at this time of the film [s]; at the simulated time if None."""
        if self.sim is None:
            self.begin(sim)
        self.sim = sim
        if self.planes is None or self.planes.sim is not sim or self.planes.world is not sim.world:
            self.planes = Planes(sim)
        scene = scene_of(sim)
        views = tuple(name for name in scene["views"] if name in SHOWN or (name == sim.scene.view.color != KIND))
        state = self.planes.state(views, chains=self.count % self.stride == 0)
        about = {"at": sim.time if at is None else at, "time": sim.time, "grains": sim.count, "tops": state.tops}
        if self.group and not (scene == self.scene and fits(state, self.group[-1][0]) and len(self.group) < GROUP):
            self.flush()
        self.scene = scene
        self.group.append((state, about))
        moving, touching = motion(sim), contacts(sim)
        numbers = {"at": about["at"], "time": sim.time, "grains": sim.count}
        numbers |= {name: moving[name] for name in MOTION} | {name: touching[name] for name in CONTACTS}
        for name, value in numbers.items():
            self.series.setdefault(name, []).append(float(f"{value:.5g}") if name not in ("at", "time") else round(value, 6))
        self.count += 1

    def flush(self) -> None:
        """Writes the frames that have come together."""
        roster, rows = merged([state.roster for state, _ in self.group])
        if not (self.rosters and same(roster, self.rosters[-1])):
            self.rosters.append(roster)
            self._put("roster", message({}, roster.planes()))
        head = {"scene": self.scene, "rows": len(roster.grain), "roster": len(self.rosters) - 1}
        self._put("group", pack(self.group, rows, head))
        self.spans.append((self.group[0][1]["at"], self.group[-1][1]["at"], len(self.group)))
        self.group = []

    def _put(self, name: str, data: bytes) -> None:
        packed = base64.b64encode(gzip.compress(data, LEVEL, mtime=0)).decode()
        self.file.write(f'<script type="text/plain" class="{name}">{packed}</script>\n')

    def end(self) -> None:
        """The rest of the page: the report of the end, what was measured on the way, and the script."""
        if self.sim is None:
            return
        self.flush()
        tail = {"report": self.sim.report(), "series": self.series, "groups": self.spans}
        self.file.write(f'<script type="application/json" id="tail">{in_page(finite(tail))}</script>\n')
        self.file.write(page()[1])


@contextmanager
def html(path: Path, fps: int) -> Iterator[Write]:
    """A page of the simulations that `write` is given, a frame each."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        film = Film(file, fps)
        yield film.write
        film.end()


def plain(text: str) -> str:
    """Text as it may stand in a page."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def fits(state: State, before: State) -> bool:
    """Whether two states may stand in one group: the same planes, and discs that are in both are the same in both."""
    shape = [one.water and (one.water["columns"], one.water["rows"]) for one in (state, before)]
    if list(state.shades) != list(before.shades) or shape[0] != shape[1]:
        return False
    if state.roster is before.roster:
        return True
    _, here, there = np.intersect1d(state.roster.keys(), before.roster.keys(), assume_unique=True, return_indices=True)
    one, other = state.roster, before.roster
    return all(np.array_equal(getattr(one, name)[here], getattr(other, name)[there]) for name in ("kind", "fixed", "radius", "tone"))


def pack(group: list[tuple[State, dict[str, Any]]], rows: list[np.ndarray | slice], head: dict[str, Any]) -> bytes:
    """The frames of a group as a page unpacks them; the discs of a frame are in these rows of the roster."""
    states, count = [state for state, _ in group], head["rows"]

    def table(name: str, absent: int | None = None) -> np.ndarray:
        return spread([getattr(state, name) for state in states], rows, count, absent)

    planes = [*halves("x", foreseen(table("x"))), *halves("y", foreseen(table("y")))]
    planes += [("angle", steps(table("angle"))), ("flags", steps(table("flags", ABSENT)))]
    for name in states[0].shades:
        planes.append((f"shade {name}", steps(spread([coarse(state.shades[name]) for state in states], rows, count))))
    water = states[0].water
    if water:
        for name in ("level", "foam", "shade"):
            planes.append((f"water {name}", steps(np.stack([state.water[name] for state in states if state.water]))))
    frames, lines = changes(group)
    planes += lines + contact_planes(states, rows, count)
    return message({**head, "frames": frames, "water": [water["columns"], water["rows"]] if water else None}, planes)


def changes(group: list[tuple[State, dict[str, Any]]]) -> tuple[list[dict[str, Any]], list[tuple[str, np.ndarray]]]:
    """What there is to say of each frame; walls and bonds of those frames in which they are others than before, one after the other."""
    frames, walls, bonds = [], [], []
    for state, about in group:
        frame = dict(about)
        if not walls or not np.array_equal(state.walls, walls[-1]):
            walls.append(state.walls)
            frame["walls"] = len(state.walls)
        if state.bonds is not None and (not bonds or not np.array_equal(state.bonds, bonds[-1])):
            bonds.append(state.bonds)
            frame["bonds"] = len(state.bonds)
        if state.chains is not None:
            frame["chains"] = len(state.chains["first"])
        frames.append(frame)
    return frames, [("walls", np.concatenate(walls)), *([("bonds", np.concatenate(bonds))] if bonds else [])]


def same(one: Roster, other: Roster) -> bool:
    """Whether two rosters hold the same."""
    return all(np.array_equal(a, b) for (_, a), (_, b) in zip(one.planes(), other.planes(), strict=True))


def merged(rosters: list[Roster]) -> tuple[Roster, list[np.ndarray | slice]]:
    """All discs of these rosters, and for each roster the rows of its discs among them."""
    first = rosters[0]
    if all(roster is first for roster in rosters):
        return first, [slice(None)] * len(rosters)
    different = list({id(roster): roster for roster in rosters}.values())
    keys = np.concatenate([roster.keys() for roster in different])
    found, where = np.unique(keys, return_index=True)
    columns = zip(*([column for _, column in roster.planes()] for roster in different), strict=True)
    whole = Roster(*(np.concatenate(parts)[where] for parts in columns))
    rows = {id(roster): np.searchsorted(found, roster.keys()) for roster in different}
    return whole, [rows[id(roster)] for roster in rosters]


def spread(columns: list[np.ndarray], rows: list[np.ndarray | slice], count: int, absent: int | None = None) -> np.ndarray:
    """Columns of the frames as a table (frames, count). Discs that are not there keep what they had, or are `absent`."""
    table = np.zeros((len(columns), count), columns[0].dtype)
    for number, (column, own) in enumerate(zip(columns, rows, strict=True)):
        table[number] = table[max(0, number - 1)] if absent is None else absent
        table[number, own] = column
    return table


def foreseen(table: np.ndarray) -> np.ndarray:
    """u16 (frames, n): differences from where the two frames before lead, so that small ones of either sign are small numbers."""
    whole = table.astype(np.int32)
    ways = np.diff(whole, axis=0, prepend=0)
    ways[2:] -= np.diff(whole, axis=0)[:-1]
    short = ways.astype(np.int16)
    return ((short << 1) ^ (short >> 15)).astype(np.uint16)


def steps(table: np.ndarray) -> np.ndarray:
    """u8 (frames, n): differences from the frame before, modulo 256."""
    return np.diff(table, axis=0, prepend=np.zeros((1, table.shape[1]), np.uint8))


def halves(name: str, table: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """A table of u16 as its high bytes and its low ones."""
    return [(f"{name} high", (table >> 8).astype(np.uint8)), (f"{name} low", (table & 255).astype(np.uint8))]


def coarse(values: np.ndarray) -> np.ndarray:
    """0 … 255 in the steps of a film."""
    return ((values.astype(np.uint16) * LAST_SHADE + 127) // 255).astype(np.uint8)


def contact_planes(states: list[State], rows: list[np.ndarray | slice], count: int) -> list[tuple[str, np.ndarray]]:
    """The contacts of all frames that have them: rows of their first discs as differences, of their second ones as they are (all bits
    set: a wall, and the way to it).
    """
    kind = np.uint16 if count < np.iinfo(np.uint16).max else np.int32
    parts: dict[str, list[np.ndarray]] = {"first": [], "second": [], "level": [], "way": []}
    for state, own in zip(states, rows, strict=True):
        if state.chains is None:
            continue
        first, second = state.chains["first"], state.chains["second"]
        wall = second < 0
        if not isinstance(own, slice):
            first, second = own[first], np.where(wall, -1, own[second])
        parts["first"].append(np.diff(first, prepend=first.dtype.type(0)).astype(kind))
        parts["second"].append(second.astype(kind))
        parts["level"].append(coarse(state.chains["level"]))
        parts["way"].append(np.where(wall, state.chains["way"], 0).astype(np.uint8))
    return [(f"chain {name}", np.concatenate(arrays)) for name, arrays in parts.items() if arrays]
