"""What a simulation measures, as arrays: single contacts, forces on walls, fields."""

from typing import Any

import numpy as np

from taichi_sand.run.clock import Clock
from taichi_sand.run.entry import reads
from taichi_sand.scene.schema import Scene
from taichi_sand.solvers.bed import Bed


class Instrument:
    """The measuring side of `Simulation`."""

    scene: Scene
    bed: Bed
    clock: Clock
    time: Any

    @reads
    def contacts(self) -> np.ndarray:
        """Contacts, (n,), by ids: those that overlap now, that pushed or pulled in the last step, or that have a liquid bridge.

        A structured array: `contacts()["force_n"]`; `pandas.DataFrame` takes it once `point` and `normal` are split. Its fields:

        `id1`, `id2`: ids of the grains, the lower one first (of clumps one contact a pair of discs); of a contact with a wall `id2` is
        -1 - k for wall k. Walls are numbered as in the scene's [[walls]], from 0; after them come the edges of the box: left, right,
        bottom, top, four in any case (`wall_names()` lists all of them).
        `disc1`, `disc2`: which disc of each grain touches; 0 of round grains, -1 of a wall.
        `bridge`: 1 if there is a liquid bridge, 0 if not.
        `point`: x, y [m], in the middle of the overlap, or on the wall; within the box where it is periodic.
        `normal`: unit vector from grain id1 to the other, or to the wall, that the forces go with.
        `overlap`: [m]; below 0 apart, where a bridge pulls.
        `force_n`, `force_t`: on the second along `normal` (pushing > 0) and along (-n_y, n_x) [N]; the first feels the opposite.
        `history`: stretch of the tangential spring [m]; md with spring friction, else 0.
        `couple`: torque of rolling resistance on the second [N m].

        Where grains are, and with it `point`, `overlap` and which contacts there are, is of this moment. Forces are those of the last
        step: with md those that gave grains their acceleration in it, with rigid the impulses of the step over its length. With
        `sleeping`, contacts among sleepers are those that they fell asleep with.
        """
        from taichi_sand.measure.contacts import contacts

        with self.clock.stage("measure"):
            return contacts(self)

    def wall_names(self) -> list[str]:
        """What the walls are called, by their numbers: their `name` if no other has it, or `walls[0]`, …; left, right, bottom, top."""
        from taichi_sand.measure.wall_numbers import names

        return names(self.scene)

    @reads
    def wall_forces(self) -> np.ndarray:
        """What grains exert on each wall, (n,), by the numbers of the walls.

        A structured array: `name`, as in `wall_names`; `force`, x and y [N]; `torque` about its pivot, of an edge about its middle [N m];
        `contacts`, how many. Forces are those of `contacts`: a bed at rest gives its weight.
        """
        from taichi_sand.measure.grain_state import wall_forces

        return wall_forces(self, self.contacts())

    @reads
    def stresses(self) -> np.ndarray:
        """Mean stress of each grain (Love, Weber) [N/m], (n, 2, 2), in the order of `ids`: - force along i times branch along j, summed
        over its contacts, over the area of the grain itself; compression is positive. Over a region, areas times stresses add up to the
        mean stress times its area.
        """
        from taichi_sand.measure.grain_state import state_of, stresses

        return stresses(self, state_of(self), self.contacts())

    @reads
    def coordination(self) -> np.ndarray:
        """Contacts of each grain that bear a force, walls included, (n,), in the order of `ids` (the report leaves out rattlers)."""
        from taichi_sand.measure.grain_state import coordination, state_of

        return coordination(state_of(self), self.contacts())

    @reads
    def hexatic(self) -> np.ndarray:
        """psi6 of each grain: mean of exp(6 i theta) over the grains that it touches, complex, (n,), in the order of `ids`; 0 without any.

        `abs` is the order, `numpy.angle` over 6 the direction of the lattice. (The view `order` takes grains near by for neighbours.)
        """
        from taichi_sand.measure.grain_state import hexatic, state_of

        return hexatic(self, state_of(self), self.contacts())

    @reads
    def energies(self) -> dict[str, np.ndarray]:
        """Energies of each grain [J], (n,) each, in the order of `ids`: kinetic, rotational, potential (-m g.x from the origin), with md
        elastic: that of the contacts' springs, normal and tangential, half of it to either grain.
        """
        from taichi_sand.measure.grain_state import energies, state_of

        return energies(self, state_of(self), self.contacts())

    @reads
    def fields(self, spacing: float | None = None, width: float | None = None) -> Any:
        """Coarse-grained fields after Goldhirsch (2010), an xarray.Dataset if xarray is installed, else a dictionary of arrays by name.

        Args:
            spacing: of the points of the grid [m]; d unless given.
            width: radius of Lucy's kernel, beyond which nothing is felt [m]; 2 d unless given, and at least `spacing`.

        Of shape (ny, nx), with a last axis x, y for vectors and two (force, plane) for tensors: density [kg/m2], momentum, velocity,
        contact_stress and kinetic_stress [N/m] (compression positive), granular_temperature [m2/s2], packing_fraction, boundary_force
        [N/m2] (of walls and fixed grains); coordinates x and y [m]. Where there is no mass velocity and temperature are NaN. Beyond walls
        the grid has a margin of `width`, so that sums over it are those of the grains; in periodic directions fields go around, and the
        spacing is the nearest that fits. Walls mirror nothing: within `width` of one, fields fall off.

        Raises:
            SandError: spacing or width are no lengths, or too small; or the images of the box slide (`edges.shear_rate`).
        """
        if self.scene.edges.shear_rate:
            raise self.scene.error("edges.shear_rate", "fields of a box whose images slide are not computed")
        from taichi_sand.measure import fields as measured
        from taichi_sand.measure.grain_state import state_of

        spacing = self.bed.diameter if spacing is None else spacing
        width = max(2 * self.bed.diameter, spacing) if width is None else width
        measured.check(spacing, width, self.scene.size)
        rows = self.contacts()
        with self.clock.stage("measure"):
            box = {"size": self.scene.size, "periodic": self.scene.periodic}
            found = measured.fields(state_of(self), rows, box, float(spacing), float(width))
        return measured.as_dataset(found, time=self.time, width=float(width))
