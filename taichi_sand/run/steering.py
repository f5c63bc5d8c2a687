"""Grains that come, go, and are put elsewhere while a simulation goes on: between launches, checked as a scene is."""

from dataclasses import replace
from typing import Any

import numpy as np

from taichi_sand import effects as effect_modules
from taichi_sand.errors import SandError, show, suggest
from taichi_sand.run import overlaps
from taichi_sand.run.arguments import array, shown, whole
from taichi_sand.run.entry import changes
from taichi_sand.run.overlaps import Discs, discs_of
from taichi_sand.scene.checks import SMALLEST
from taichi_sand.scene.schema import MOST_GRAINS, Scene
from taichi_sand.scene.shapes import BUILT_IN, Form, form, inertia, mass
from taichi_sand.world import edit
from taichi_sand.world.extras.steady_force import exert
from taichi_sand.world.reading import read_columns
from taichi_sand.world.search.images import folded
from taichi_sand.world.sleep.fall_asleep import wake

DENSITY = 2650.0
"""Of grains that are added where the scene has no table for any [kg/m2]."""
ANNOUNCE = "a [[sources]] table with `radius` and `until = 0` announces grains that are added later"
MOST_SHOWN = 5
"""So many ids are named in an error."""


class Steering:
    """The side of `Simulation` by which grains are put in, taken out and set."""

    scene: Scene
    world: Any
    bed: Any
    made: int
    removed: int
    ids: np.ndarray
    renew: Any
    hand: Any
    planned: Any
    _become: Any
    _have_room: Any
    _bed_with: Any
    _go_on_with: Any
    fit_tables: Any

    @changes
    def add(
        self, positions: Any, *, radius: Any, velocities: Any = 0.0, angles: Any = 0.0, spins: Any = 0.0, kind: int | str = 0
    ) -> np.ndarray:
        """Adds grains.

        Args:
            positions: of their centres [m], shape (n, 2).
            radius: of a disc, of which a shape has several, as in a scene [m]: a number, or (n,). None larger than the largest that the
                scene has, or announces by a `[[sources]]` table: with `until = 0` it makes none itself.
            velocities: [m/s], shape (n, 2), or (2,) for all.
            angles: [rad], a number or (n,).
            spins: [rad/s], a number or (n,).
            kind: which `[[grains]]` table they are of, or after them which of the `[[sources]]`: it says shape and density; or the name
                of the shape of one. Of a table that is bonded, discs that are bonded to none.

        Returns:
            Their ids, shape (n,): no grain has ever had them.

        Raises:
            SandError: an argument is wrong, a grain lies outside of the box, or overlaps another one, a wall or an edge by more than
                `solver.tolerance` allows at rest; then nothing has changed.
        """
        count = len(rows_of("add", positions))
        if self.world.count[None] + count > MOST_GRAINS:
            raise SandError(f"add: positions: there cannot be more than {MOST_GRAINS} grains")
        number, shape, density = self._kind(kind)
        size = array("add", "radius", radius, (count,))
        if count:
            self._check_size(shape, size)
        new = {
            "position": self._inside("add", positions, count),
            "velocity": array("add", "velocities", velocities, (count, 2)),
            "angle": array("add", "angles", angles, (count,)),
            "spin": array("add", "spins", spins, (count,)),
            "radius": shape.reach * size,
            "mass": mass(shape, shape.reach * size, density),
            "inertia": inertia(shape, shape.reach * size, density),
            "kind": np.full(count, number, np.int32),
        }
        ids = self.made + np.arange(count)
        if not count:
            return ids
        discs = discs_of(self, ids, *(new[name] for name in ("position", "angle", "radius", "kind")))
        self._check_free("add", discs, self._discs(), 0.0)
        bed = self._bed_with(new)
        wake(self.world)
        self.fit_tables()
        self._have_room(count)
        edit.add(self.world, new, self.made)
        self.made += count
        self._go_on_with(bed)
        return ids

    @changes
    def remove(self, ids: Any) -> None:
        """Takes grains out; bonds that they have break.

        Args:
            ids: of which, shape (n,) or a number.

        Raises:
            SandError: there is no such grain; then nothing has changed.
        """
        slots = self._slots("remove", ids)
        if len(slots):
            edit.remove(self.world, slots)
            self.removed += len(slots)
            self.renew()

    @changes
    def set_state(self, ids: Any, *, positions: Any = None, velocities: Any = None, angles: Any = None, spins: Any = None) -> None:
        """Gives grains other places, velocities, angles and spins; what is not given stays. One in another place meets others anew: what
        its contacts carried is forgotten, its bonds are stretched.

        Args:
            ids: of which, shape (n,) or a number.
            positions: [m], shape (n, 2).
            velocities: [m/s], shape (n, 2), or (2,) for all.
            angles: [rad], a number or (n,).
            spins: [rad/s], a number or (n,).

        Raises:
            SandError: an argument is wrong, there is no such grain, it is fixed and cannot move, or it would lie outside of the box, or
                overlap another one, a wall or an edge by more than `solver.tolerance` allows at rest, and deeper than the deepest of
                these grains does already; then nothing has changed.
        """
        slots, count = self._slots("set_state", ids), np.size(ids)
        given = {"positions": positions, "velocities": velocities, "angles": angles, "spins": spins}
        widths = {"positions": (2,), "velocities": (2,), "angles": (), "spins": ()}
        columns = {"positions": "position", "velocities": "velocity", "angles": "angle", "spins": "spin"}
        values = {columns[k]: array("set_state", k, v, (count, *widths[k])) for k, v in given.items() if v is not None}
        if "position" in values:
            values["position"] = self._inside("set_state", positions, count)
        if not count or not values:
            return
        before = self._read(slots)
        held = np.flatnonzero(before["fixed"])
        for name in ("velocity", "spin"):
            if name in values and values[name][held].any():
                raise SandError(f"set_state: grain {before['id'][held][0]} is fixed: its {name} can only be 0")
        if "position" in values or "angle" in values:
            self._check_places(before, values)
        bed = self._bed_with({**before, **values})
        wake(self.world)
        self.fit_tables()
        edit.change(self.world, self._slots("set_state", ids), values)
        self._go_on_with(bed)

    @changes
    def push(self, ids: Any, *, force: Any = (0.0, 0.0), torque: Any = 0.0) -> None:
        """Pushes grains with a steady force and torque, from now on in every step, until they are pushed otherwise: with none they are let
        go. It is kept in checkpoints. Fixed grains do not give way. The first push switches on the effect `push`, which takes some
        seconds to compile; a scene with a table `[effects.push]` is compiled with it from the start.

        Args:
            ids: of which, shape (n,) or a number.
            force: [N], shape (2,) for all, or (n, 2).
            torque: [N m], a number or (n,).

        Raises:
            SandError: an argument is wrong, or there is no such grain; then nothing has changed.
        """
        self._slots("push", ids)
        count = np.size(ids)
        push = np.column_stack([array("push", "force", force, (count, 2)), array("push", "torque", torque, (count,))])
        if not count:
            return
        if "push" not in self.scene.effects:
            if not push.any():
                return
            self._become(self.scene.model_copy(update={"effects": {**self.scene.effects, "push": {}}}))
        wake(self.world)
        self.fit_tables()
        exert(self.world, self._slots("push", ids).astype(np.int32), push.astype(edit.real_of(self.world)))
        self._go_on_with(replace(self.bed, **effect_modules.bed(effect_modules.check(self.scene), self.world)))

    def _check_places(self, before: dict[str, np.ndarray], values: dict[str, np.ndarray]) -> None:
        """SandError unless grains may lie where they are put."""
        old, new = (
            discs_of(self, one["id"], *(one[name] for name in ("position", "angle", "radius", "kind")))
            for one in (before, {**before, **values})
        )
        others = self._discs().but(before["id"])
        deepest = max(overlaps.between(self, old, others)[0], overlaps.with_walls(self, old)[0])
        self._check_free("set_state", new, others, deepest)

    def _check_free(self, function: str, new: Discs, others: Discs, least: float) -> None:
        """SandError if one of these discs overlaps another one, a wall or an edge by more than may be, and than `least` [m]."""
        allowed = max(least, self.scene.solver.tolerance * self.bed.diameter) * (1 + 1e-5)
        rule = f"more than {allowed:.3g} m, which is allowed"
        overlap, one, other = overlaps.between(self, new, others)
        if overlap > allowed:
            raise SandError(f"{function}: grain {one} would overlap grain {other} by {overlap:.3g} m, {rule}")
        overlap, one = overlaps.with_walls(self, new)
        if overlap > allowed:
            raise SandError(f"{function}: grain {one} would overlap a wall or an edge by {overlap:.3g} m, {rule}")

    def _kind(self, kind: Any) -> tuple[int, Form, float]:
        """Number of a table of grains or sources, and the shape and density of what it makes."""
        tables = (*self.scene.grains, *self.scene.sources)
        names = [table.shape for table in tables] or ["disc"]
        if isinstance(kind, str):
            if kind not in names:
                known = f"{suggest(kind, names)} (there are: {', '.join(sorted(set(names)))})"
                raise SandError(f"add: kind = {show(kind)} is the shape of no table of this scene{known}")
            kind = names.index(kind)
        number = isinstance(kind, int | np.integer) and not isinstance(kind, bool)
        if not number or not 0 <= kind < len(names):
            raise SandError(
                f"add: kind = {shown(kind)} must be the number of a [[grains]] or [[sources]] table, 0 … {len(names) - 1}, or a shape"
            )
        if not tables:
            return 0, form("disc", BUILT_IN["disc"]), DENSITY
        return int(kind), self.scene.form_of(tables[int(kind)]), tables[int(kind)].density

    def _check_size(self, shape: Form, size: np.ndarray) -> None:
        """SandError unless tables, stiffness and step are made for discs of these radii (n,) in a grain of this shape."""
        if size.min() < SMALLEST:
            raise SandError(f"add: radius = {show(float(size.min()))} must be at least {SMALLEST:g} m")
        if not len(self.planned) and self.hand is None:
            raise SandError(f"add: the scene has neither grains nor sources, and does not say how large grains will be; {ANNOUNCE}")
        most = float(self.world.box[None].largest) / 2 / shape.reach
        if size.max() > most * (1 + 1e-5):
            raise SandError(
                f"add: radius = {show(float(size.max()))} must be at most {most:.4g} m, as of the largest there are; {ANNOUNCE}"
            )

    def _inside(self, function: str, positions: Any, count: int) -> np.ndarray:
        """Positions (n, 2) within the box, where it is periodic folded into it; SandError if one is not."""
        found, size = array(function, "positions", positions, (count, 2)), np.array(self.scene.size)
        found = folded(found, self.world, size)
        out = np.flatnonzero(((found < 0) | (found > size)).any(axis=1))
        if len(out):
            box = f"x 0 … {size[0]:g}, y 0 … {size[1]:g} m"
            raise SandError(f"{function}: positions[{out[0]}] = {show(found[out[0]].tolist())} lies outside the box, {box}")
        return found

    def _slots(self, function: str, ids: Any) -> np.ndarray:
        """Slots (n,) of grains; SandError if one is not there, or named twice."""
        wanted = whole(function, "ids", ids)
        _, numbers = edit.places(self.world)
        order = np.argsort(numbers[:, 0], kind="stable")
        known = numbers[order, 0]
        at = np.searchsorted(known, wanted)
        missing = wanted[(at >= len(known)) | (known[np.minimum(at, len(known) - 1)] != wanted)] if len(known) else wanted
        if len(missing):
            raise SandError(f"{function}: ids: there is no grain {listed(missing)} (any more); `ids` of the simulation has those there are")
        twice = np.unique(wanted)
        if len(twice) < len(wanted):
            raise SandError(f"{function}: ids: a grain is named twice")
        return order[at]

    def _read(self, slots: np.ndarray) -> dict[str, np.ndarray]:
        """What is known of the grains in these slots, in their order."""
        _, numbers = edit.places(self.world)
        table = read_columns(self.world, ("id", "position", "velocity", "angle", "spin", "radius", "kind"))
        rows = np.searchsorted(table["id"], numbers[slots, 0])
        found = {name: values[rows] for name, values in table.items()}
        return found | {"fixed": numbers[slots, 2] == 1}

    def _discs(self) -> Discs:
        """Discs of all grains there are."""
        if self.world.clumps:
            return discs_of(self, *read_columns(self.world, ("id", "position", "angle", "radius", "kind")).values())
        numbers, names = edit.places(self.world)
        return Discs(numbers[:, :2], numbers[:, 2], names[:, 0])


def rows_of(function: str, positions: Any) -> np.ndarray:
    """Positions (n, 2); SandError if they are something else."""
    try:
        given = np.asarray(positions, float)
    except (TypeError, ValueError):
        given = np.zeros(1)
    if given.shape == (0,):
        given = given.reshape(0, 2)
    if given.ndim != 2 or given.shape[-1] != 2:
        raise SandError(f"{function}: positions must be numbers of shape (n, 2): x and y of each grain")
    return given


def listed(ids: np.ndarray) -> str:
    """Ids in words."""
    return ", ".join(map(str, ids[:MOST_SHOWN])) + (", …" if len(ids) > MOST_SHOWN else "")
