"""What a simulation measures, as arrays: single contacts, forces on walls, fields."""

import numpy as np

from taichi_sand.run.clock import Clock
from taichi_sand.run.entry import reads
from taichi_sand.scene.schema import Scene


class Instrument:
    """The measuring side of `Simulation`."""

    scene: Scene
    clock: Clock

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
        """What the walls are called, by their numbers: `walls[0]`, …, left, right, bottom, top."""
        from taichi_sand.measure.wall_numbers import names

        return names(self.scene)
