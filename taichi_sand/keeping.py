"""Checkpoints: a simulation written to a file, and gone on with from there."""

from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

from taichi_sand.scene.schema import Scene
from taichi_sand.solvers.bed import Bed
from taichi_sand.world import checkpoint


class Keeping:
    """The side of `Simulation` that outlives it."""

    scene: Scene
    first_walls: list
    lost: int
    room: int
    hand: Any
    bed: Bed
    world: Any
    solver: Any

    def _fields(self) -> dict[str, Any]:
        return checkpoint.fields_of((self.world, self.solver), "")

    def save(self, path: str | Path, **more: Any) -> None:
        """Writes a checkpoint from which `resume` goes on as if nothing had happened; `more` (JSON) is kept with it."""
        about = {"scene": self.scene.to_json(), "lost": self.lost, "room": self.room, "hand": self.hand is not None}
        about |= {name: getattr(self, name) for name in ("made", "removed", "epoch", "numbers")}
        about["first_walls"] = [wall.model_dump(exclude_unset=True) for wall in self.first_walls]
        checkpoint.save(path, {**about, **more, "bed": asdict(self.bed)}, self._fields())

    @classmethod
    def resume(cls, path: str | Path, *, arch: str = "cpu", threads: int | None = None) -> Self:
        """The simulation that was saved to `path`; SandError if the file is damaged, foreign or of another version."""
        about, arrays = checkpoint.load(path)
        scene = Scene.from_json(about["scene"])
        sim = cls(scene.with_walls(about["first_walls"]), arch=arch, threads=threads, room=about["room"], hand=about["hand"])
        sim.scene = scene
        checkpoint.restore(sim._fields(), arrays, path)
        sim.made, sim.removed, sim.epoch, sim.numbers = about["made"], about["removed"], tuple(about["epoch"]), about["numbers"]
        sim.bed, sim.steps = Bed(**about["bed"]), int(sim.world.pace[None].done)
        return sim
