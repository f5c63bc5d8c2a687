"""What can be changed of a simulation while it goes on: live numbers, walls."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_sand.run import live
from taichi_sand.run.entry import changes, reads
from taichi_sand.scene.materials import matrices
from taichi_sand.scene.moving import moving_walls
from taichi_sand.scene.schema import Scene
from taichi_sand.solvers import choose
from taichi_sand.solvers.bed import Bed, height_of
from taichi_sand.world.extras.materials import write_materials
from taichi_sand.world.sleep.fall_asleep import wake
from taichi_sand.world.walls.build import (
    change_walls,
    check_speeds,
    fastest_wall,
    shortest_shake,
    standing_walls,
    structure_fits,
    wall_loads,
)


class Tuning:
    """The side of `Simulation` that is turned by hand."""

    scene: Scene
    over: dict[str, float]
    numbers: dict[str, float]
    bed: Bed
    world: Any
    planned: Any
    renew: Any
    fit_tables: Any
    _adopt: Any
    _move_walls: Any
    _go_on_with: Any
    heard: Callable[[str, tuple, dict[str, Any]], None] | None = None
    """Is told what is called from outside that changes the simulation: name, arguments."""

    @reads
    def get(self, key: str) -> Any:
        """The value of a live number, by its dotted key in the scene (`gravity`, `solver.tolerance`, `effects.friction.mu`): as a scene may
        have it, or as it was set beyond that; None for one of [solver] that is not given, and follows from the tolerance.

        Raises:
            SandError: nothing that may change has this key; the sentence names what has.
        """
        value = live.read(self.scene, key)
        return self.over.get(key, value)

    @changes
    def set(self, key: str, value: Any, *, unphysical: bool = False) -> None:
        """Goes on with another value of a live number; `key` as for `get`. It stays through looks, checkpoints, and undoing.

        Args:
            key: which.
            value: as in a scene file; None takes one of [solver] back to what follows from the tolerance.
            unphysical: lets parameters of effects, and the restitution, go beyond their ranges.

        Raises:
            SandError: nothing that may change has this key, or it may not have this value; then nothing has changed.
        """
        found = live.beyond(self.scene, key, value) if unphysical else None
        over = {name: number for name, number in self.over.items() if name != key}
        if found:
            over[key], value = found
        scene = live.written(self.scene, key, value)
        wake(self.world)
        self._adopt(scene, self._bed_for(scene), over)

    @changes
    def retune(self, scene: Scene) -> None:
        """Goes on with gravity and all numbers of solver and effects that `scene` has. Values beyond their ranges stay, where the scene has
        not got another one for that key.

        Raises:
            SandError: it differs in more than what may change; then nothing has changed.
        """
        live.check_live(self.scene, scene)
        wake(self.world)
        self._adopt(scene, self._bed_for(scene), live.kept(self.over, self.scene, scene))

    def mix(self) -> None:
        """Contacts between materials are as the scene says now."""
        if self.world.mixed:
            mu = live.kernel_numbers(self.scene, self.over, self.numbers).get("friction_mu", 0.0)
            friction, restitution = matrices(self.scene, mu, self.scene.solver.restitution)
            write_materials(self.world, friction, choose(self.scene.solver.kind).bounces(self.scene, self.numbers, self.bed, restitution))

    def _bed_for(self, scene: Scene) -> Bed:
        """The bed as it is under the gravity of `scene`."""
        if scene.gravity == self.scene.gravity:
            return self.bed
        gravity = float(np.hypot(*scene.gravity))
        height = height_of(scene.gravity, scene.size)
        return replace(self.bed, gravity=gravity, drop=height if gravity else 0.0, height=height)

    @changes
    def set_walls(self, walls: Sequence[Any]) -> None:
        """Goes on with these `[[walls]]`, a table each as in a scene file, in the place of those there are. One that moves sets out from
        its points now; one whose table is that of a wall that moves already goes on with it. The first that moves, has a
        `force`, a friction of its own or is a belt costs some seconds of compiling.

        Raises:
            SandError: a table is wrong, a wall is too fast to be followed, or there is no room for them (with `hand` there is room for
                many); then nothing has changed.
        """
        scene = self.scene.with_walls(walls)
        same, faster = moving_walls(scene) == moving_walls(self.scene), fastest_wall(scene) > fastest_wall(self.scene)
        if same and not faster and structure_fits(self.world, scene):
            change_walls(self.world, self.scene, scene)
            self.scene = scene
            self.renew()
            return
        drive = max([fastest_wall(scene), *(float(np.hypot(*source.velocity)) for source in scene.sources)])
        speeds = {name: max(drive, getattr(self.bed, name)) for name in ("speed", "fast")}
        bed = replace(self.bed, drive=drive, shaking=shortest_shake(scene), **speeds, **wall_loads(scene, self.planned))
        check_speeds(scene, choose(scene.solver.kind).numbers(scene, bed)["speed_cap"])
        wake(self.world)
        self.fit_tables()
        self._move_walls(scene)
        self.scene = scene
        self._go_on_with(bed)

    @property
    @reads
    def wall_points(self) -> list[np.ndarray]:
        """Corners of every one of the `[[walls]]` where it is now [m], (n, 2) each, of a closed one the first again at the end."""
        return standing_walls(self.world, self.scene)
