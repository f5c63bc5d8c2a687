"""What acts between launches, and when: effects every so often, or when they have said; and sources."""

from collections.abc import Callable
from typing import Any

from taichi_sand.world import sources
from taichi_sand.world.tables import steps_within

Act = Callable[[Any, Any], Any]


class Pausing:
    """The side of `Simulation` that sees to that."""

    scene: Any
    world: Any
    solver: Any
    steps: int
    step: float
    pausing: dict[str, Any]
    due: dict[str, int]
    _pour: Any

    def _pauses(self) -> list[tuple[Act, int]]:
        """What acts between launches, and after which step next."""
        pauses = []
        for name, effect in self.pausing.items():
            if name in self.due:
                pauses.append((self._pace(name, effect), self.due[name]))
            else:
                pauses.append((effect.on_pause, self._next(steps_within(effect.interval, self.step))))
        if self.scene.sources:
            pauses.append((self._pour, self._next(sources.steps_between(self.step))))
        return pauses

    def _next(self, every: int) -> int:
        """The next step whose number is a multiple of `every`."""
        return self.steps - self.steps % every + every

    def _pace(self, name: str, effect: Any) -> Act:
        """The pause of an effect that says itself when the next one is due."""

        def act(world: Any, solver: Any) -> None:
            self.due[name] = self.steps + max(1, effect.on_pause(world, solver))

        return act

    def _begin_pauses(self) -> None:
        """Effects that pace themselves act before the first step."""
        self.due = {}
        for name, effect in self.pausing.items():
            if effect.interval is None:
                self._pace(name, effect)(self.world, self.solver)

    def _keep_due(self, before: float) -> None:
        """What was due in steps of `before` [s] is due as much time from now."""
        for name, due in self.due.items():
            self.due[name] = self.steps + max(1, round((due - self.steps) * before / self.step))
