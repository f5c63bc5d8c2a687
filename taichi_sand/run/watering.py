"""Water by hand: on grains, and of the effect `water`."""

from typing import Any

from taichi_sand.errors import SandError
from taichi_sand.run.entry import changes
from taichi_sand.world.extras.wetness import pour


class Watering:
    """The side of `Simulation` that is watered."""

    world: Any
    pausing: dict[str, Any]
    renew: Any

    @changes
    def wet(self, x: float, y: float, radius: float, amount: float) -> int:
        """Adds `amount` (below 0: takes water away) to the wetness, 0 … 1, of the grains within `radius` of (x, y) [m], and wakes who
        sleeps; returns how many grains these are. SandError without the effect `moisture`.
        """
        if not hasattr(self.world.carried, "wetness"):
            raise SandError("nothing can be wetted: the scene has no table [effects.moisture]", "effects.moisture")
        found = pour(self.world, x, y, radius, amount)
        if self.world.sleeps:
            self.renew()
        return int(found)

    @changes
    def pour_water(self, x: float, y: float, radius: float, velocity: tuple[float, float] = (0.0, 0.0)) -> float:
        """Fills the box with water of this velocity [m/s] within `radius` of (x, y) [m], where it is not full yet; returns how much that
        is [m2]: 0 where there is no room for more. SandError without the effect `water`.
        """
        return self._by_hand().pour(self._fluid(), x, y, radius, velocity)

    @changes
    def drain_water(self, x: float, y: float, radius: float) -> float:
        """Takes out the water within `radius` of (x, y) [m]; returns how much that was [m2]. SandError without the effect `water`."""
        return self._by_hand().drain(self._fluid(), x, y, radius)

    @changes
    def push_water(self, x: float, y: float, radius: float, velocity: tuple[float, float]) -> None:
        """Has the water within `radius` of (x, y) [m] move with `velocity` [m/s]. SandError without the effect `water`."""
        self._by_hand().sweep(self._fluid(), x, y, radius, velocity)

    def _fluid(self) -> Any:
        return self.pausing["water"].fluid

    def _by_hand(self) -> Any:
        """What does it: imported only where there is water."""
        if "water" not in self.pausing:
            raise SandError("there is no water: the scene has no table [effects.water]", "effects.water")
        from taichi_sand.effects.water import byhand

        return byhand
