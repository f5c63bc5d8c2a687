"""Looks at a simulation while it goes on: stiffness and step follow what the pile has become."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_sand import effects as effect_modules
from taichi_sand.scene.schema import Scene
from taichi_sand.scene.shapes import BUILT_IN, form
from taichi_sand.solvers import choose
from taichi_sand.solvers.bed import DENSE, EARTH, REST, Bed, depth_of
from taichi_sand.solvers.tolerance import follows_tolerance
from taichi_sand.world import edit
from taichi_sand.world.tables import steps_within

LOOK, GROWTH = 0.25 / math.sqrt(0.01 / EARTH), 1.2
"""Simulated time between two looks at the pile, in sqrt(d / g), 0.25 s for grains of 1 cm; and by how much it must have grown in depth for
stiffness and step to follow."""
WORTH = 1.2
"""What was faster than it is now keeps its stiffness and step unless steps can be so many times longer."""


class Looking:
    """The side of `Simulation` that keeps stiffness and step right."""

    scene: Scene
    bed: Bed
    numbers: dict[str, float]
    over: dict[str, float]
    sizes: Any
    world: Any
    steps: int
    step: float
    epoch: tuple[int, float]
    count: int
    renew: Any
    _adopt: Any

    def _look_every(self) -> int:
        return steps_within(LOOK * self.bed.moment, self.step)

    def _steps_to_look(self) -> int:
        """Steps until the next look at the depth, counted from when the step last changed."""
        return self._look_every() - (self.steps - self.epoch[0]) % self._look_every()

    def _look(self) -> None:
        """Stiffness and step follow the depth of a pile that has grown, what the contacts of one at rest show, how fast grains are, and
        how fast they flow.
        """
        if not self.count or self._sleepy():
            return
        if self.bed.gravity:
            self.bed = replace(self._deeper(self.bed), lift=effect_modules.lift(self.scene.effects, self.world))
        unit = math.sqrt(self.bed.gravity * self.bed.diameter)
        share, deep, fastest = edit.strained(self.world, self.scene.solver.tolerance * self.bed.diameter, REST * unit)
        if self.bed.gravity and follows_tolerance(self.scene.solver):
            self.bed = self.bed.seen(share, deep)
        calmer = self.bed.moving(fastest, edit.flow(self.world, DENSE) if share > 0.01 else 0.0)
        self.bed = self._worth(calmer, squeezed=fastest <= REST * unit and deep[0] > 0.01)
        self._keep_up()

    def _hasten(self) -> None:
        """Stiffness and step follow a grain that is faster than they are made for."""
        *_, fastest = edit.strained(self.world, 0.0, 0.0)
        self.bed = self.bed.outrun(fastest)
        self._keep_up()

    def _keep_up(self) -> None:
        """Stiffness and step are those for the bed as it is."""
        self.world.pace[None].hasty = 0
        if choose(self.scene.solver.kind).numbers(self.scene, self.bed) != self.numbers:
            self._adopt(self.scene, self.bed, self.over)

    def _worth(self, calmer: Bed, squeezed: bool) -> Bed:
        """`calmer`, but made for speeds as before where steps would hardly be longer, as contacts of another stiffness stir who has come to
        rest; and where who is at rest is `squeezed` deeper than the tolerance as it is.
        """
        longer = choose(self.scene.solver.kind).numbers(self.scene, calmer)["step"] / self.step
        keeps = longer > 1.0 and (squeezed or longer < WORTH)
        return replace(calmer, fast=self.bed.fast, flow=self.bed.flow) if keeps else calmer

    def _deeper(self, bed: Bed) -> Bed:
        """The bed as deep as it is now, if it has grown."""
        numbers, whole = edit.places(self.world)
        free = whole[:, 2] == 0
        if free.any():
            radius = numbers[:, 2] * self.sizes[whole[:, 1]]
            depth, load = depth_of(numbers[free, :2], radius[free], 1 / numbers[free, 3], self.scene.gravity)
            if depth > GROWTH * bed.depth or load > GROWTH * bed.load:
                return replace(bed, depth=max(depth, bed.depth), load=max(load, bed.load))
        return bed

    def _bed_with(self, grains: dict[str, np.ndarray]) -> Bed:
        """The bed with grains that are put somewhere by hand, of position, velocity (n, 2), radius, kind and if they are new mass (n,).

        Raises:
            SandError: the scene's own step or stiffness cannot do with them.
        """
        bed, gravity = self.bed, np.array(self.scene.gravity)
        speed = float(np.hypot(*grains["velocity"].T).max())
        down = gravity / max(float(np.hypot(*gravity)), 1e-12)
        drop = float((np.maximum(down * np.array(self.scene.size), 0.0).sum() - grains["position"] @ down).max())
        changed: dict[str, Any] = {"speed": max(bed.speed, speed), "fast": max(bed.fast, speed), "drop": max(bed.drop, drop)}
        if "mass" in grains:
            forms = [self.scene.form_of(table) for table in (*self.scene.grains, *self.scene.sources)] or [form("disc", BUILT_IN["disc"])]
            lightness, size = (np.array([getattr(one, name) for one in forms])[grains["kind"]] for name in ("lightness", "size"))
            changed |= {
                "least_mass": min(bed.least_mass, float((grains["mass"] / lightness).min())),
                "solid": max(bed.solid, float((grains["mass"] / (2 * size * grains["radius"]) ** 2).max())),
                "clumps": bed.clumps or bool(lightness.max() > 1.0),
            }
        bed = replace(bed, **changed)
        choose(self.scene.solver.kind).numbers(self.scene, bed)
        return bed

    def _go_on_with(self, bed: Bed) -> None:
        """Stiffness and step are those for this bed, as deep as it is now; and the neighbour list is built anew."""
        if bed.gravity:
            bed = self._deeper(bed)
        if choose(self.scene.solver.kind).numbers(self.scene, bed) != self.numbers:
            self._adopt(self.scene, bed, self.over)
        else:
            self.bed = bed
        self.renew()

    def _sleepy(self) -> bool:
        """Whether this look can be left out: with few awake a pile grows more slowly, with nobody not at all."""
        if not self.world.sleeps:
            return False
        awake = self.world.sleep.state[None].awake
        number = (self.steps - self.epoch[0]) // self._look_every()
        return not awake or number % max(1, math.floor((GROWTH - 1) * self.count / awake)) != 0
