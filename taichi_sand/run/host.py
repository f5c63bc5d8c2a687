"""What a simulation keeps on the host that changes while it runs, in one record: what checkpoints, undo, quick saves and the hand-over to
another solver go by. All else that changes is in fields.
"""

from dataclasses import asdict, dataclass, fields
from typing import Any, Self

from taichi_sand.run.events import Stages
from taichi_sand.scene.schema import Scene
from taichi_sand.solvers.bed import Bed


@dataclass(frozen=True)
class Host:
    """That record."""

    scene: Scene  # as it is simulated now
    over: dict[str, float]  # live numbers beyond the range that a scene may have, by key
    bed: Bed
    numbers: dict[str, float]  # of the solver
    steps: int  # done
    epoch: tuple[int, float]  # steps and time [s] when the step was last changed
    owed: float  # time that was asked for and not simulated yet [s]: less than half a step; below 0 = more was simulated
    made: int  # grains, those of the start included
    removed: int  # grains, by hand
    flagged: dict[str, list[float]]  # of flags, by their kinds: when they were first raised [s], and the speed cap there was [m/s]
    due: dict[str, int]  # steps after which effects that pace themselves act next, by name
    stages: Stages  # what has come of its events

    @classmethod
    def of(cls, sim: Any) -> Self:
        """That of `sim`, at this moment."""
        return cls(**{field.name: kept(getattr(sim, field.name)) for field in fields(cls)})

    def give(self, sim: Any) -> None:
        """Makes it that of `sim`, whose fields are those of the same moment."""
        for field in fields(self):
            setattr(sim, field.name, kept(getattr(self, field.name)))

    def to_json(self) -> dict[str, Any]:
        """As JSON can hold it."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return found | {"scene": self.scene.to_json(), "bed": asdict(self.bed), "stages": self.stages.to_json()}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """What `to_json` gave; KeyError or TypeError if it is something else."""
        named = {field.name: data[field.name] for field in fields(cls)}
        step, time = named["epoch"]
        tables: dict[str, Any] = named | {"epoch": (int(step), float(time))}
        tables |= {
            "scene": Scene.from_json(named["scene"]),
            "bed": Bed(**named["bed"]),
            "stages": Stages.from_json(named["stages"]),
        }
        return cls(**tables)


def kept(value: Any) -> Any:
    """A value that stays as it is when its owner goes on."""
    return dict(value) if isinstance(value, dict) else value
