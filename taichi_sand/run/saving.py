"""Checkpoints: a simulation written to a file, and gone on with from there."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from taichi_sand.run import belief, rooms
from taichi_sand.run.entry import check_runner, reads
from taichi_sand.run.growing import rooms_of
from taichi_sand.run.host import Host
from taichi_sand.scene.schema import Scene
from taichi_sand.taichi_support import field_pool, runtime
from taichi_sand.taichi_support.turns import turn
from taichi_sand.world import checkpoint
from taichi_sand.world.search.growth import Rooms

ROOM = 1_000_000
"""Numbers that a simulation may take beside its tables."""


def misfit(about: dict[str, Any], announced: dict[str, Any]) -> str:
    """What is wrong with the arrays that a checkpoint announces, or ""."""
    scene = Scene.from_json(about["host"]["scene"])
    shapes = {name: array.shape for name, array in announced.items()}
    return rooms.misfit(scene, about["room"], Rooms(*about["rooms"]), shapes)


def laid_out(scene: Scene, walls: Sequence[Any]) -> Scene:
    """The scene whose tables are as those of `scene`, where they have been made for these walls: they are not to be planned anew."""
    return scene.with_walls(walls).model_copy(update={"events": ()})


class Keeping:
    """The side of `Simulation` that outlives it."""

    scene: Scene
    home: Scene
    first_walls: Any
    room: int
    hand: Any
    world: Any
    solver: Any
    pausing: Any
    returning: Any
    take_room: Any
    _world: Any
    recorders: list[Any]

    def _fields(self) -> dict[str, Any]:
        return checkpoint.fields_of((self.world, self.solver), "")

    @reads
    def save(self, path: str | Path, **more: Any) -> None:
        """Writes a checkpoint from which `resume` goes on as if nothing had happened; `more` (JSON) is kept with it."""
        first_walls = [wall.model_dump(exclude_unset=True) for wall in self.first_walls]
        home = {"home": self.home.to_json()} if self.home.events else {}  # events change the scene
        made_for = {"room": self.room, "hand": self.hand is not None, "first_walls": first_walls, "rooms": rooms_of(self.world)}
        checkpoint.save(path, {**more, **made_for, **home, "host": Host.of(self).to_json()}, self._fields())

    @reads
    def close(self) -> None:
        """Ends it: the next simulation that needs such tables gets its memory and kernels, and much memory that nobody uses goes back to
        the system. Nothing but this can be asked of it afterwards. `with Simulation(…) as sim:` closes it at the end.
        """
        check_runner(self)
        for recorder in list(self.recorders):
            recorder.stop()
        self._world, self.solver, self.hand, self.pausing = None, None, None, {}
        self.returning()
        runtime.done(self)

    @reads
    def __enter__(self) -> Self:
        assert self.world  # SandError if it is closed
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @classmethod
    def resume(cls, path: str | Path, *, arch: str = "cpu", threads: int | None = None) -> Self:
        """The simulation that was saved to `path`; SandError if the file is damaged, foreign or of another version."""
        about, arrays = checkpoint.load(path, misfit)
        room = 2 * sum(array.size for array in arrays.values()) + ROOM
        with turn, checkpoint.believing(path, "checkpoint"), field_pool.at_most(room):
            host = Host.from_json(about["host"])
            make: Any = cls
            walls = laid_out(host.scene, about["first_walls"])
            sim = make(walls, arch=arch, threads=threads, room=about["room"], hand=about["hand"] is True)
            sim.take_room(Rooms(*about["rooms"]))
            tables = checkpoint.tables_of(sim._fields())
            checkpoint.check_shapes(tables, arrays)
            belief.check(sim, host, tables, arrays)
            checkpoint.restore(sim._fields(), arrays)
            host.give(sim)
            sim.mix()  # what these tables hold follows from the scene, and is not believed
            sim.home = Scene.from_json(about["home"]) if "home" in about else sim.scene
        return sim
