"""What is looked at closely while it is played: a grain, a ruler's line, plots. Nothing of it changes the simulation, or is recorded."""

import math
from typing import Any

from taichi_sand.measure import grain, profiles
from taichi_sand.play.plots import FIRST, PLOTS
from taichi_sand.view.text import number_text

Rows = list[tuple[str, str]]


class Watching:
    """What of it is shown."""

    def __init__(self) -> None:
        self.grain: int | None = None  # id
        self.line: profiles.Line | None = None  # of the ruler [m]
        self.plots: set[str] = set(FIRST)

    def forget(self) -> None:
        """There is another scene."""
        self.grain = self.line = None

    def plot(self, name: str, on: bool) -> None:
        """Shows a plot, or no more."""
        if name in PLOTS:
            (self.plots.add if on else self.plots.discard)(name)

    def look(self, session: Any, now: dict[str, Any], before: dict[str, Any]) -> dict[str, Any]:
        """What there is to see of all that, for JSON; `now` and `before`: what was measured this time and the last."""
        return {
            "grain": self._grain(session),
            "line": self._line(session),
            "plots": {name: PLOTS[name].of(session, now, before) for name in PLOTS if name in self.plots} if now else {},
        }

    def _grain(self, session: Any) -> dict[str, Any] | None:
        if self.grain is None:
            return None
        found = grain.about(session.sim, self.grain)
        if found is None:
            self.grain = None
            return None
        return {"id": found["id"], "rows": lines_of(found), "contacts": [contact_of(one) for one in found["contacts"]]}

    def _line(self, session: Any) -> dict[str, Any] | None:
        if self.line is None:
            return None
        x0, y0, x1, y1 = self.line
        dx, dy = x1 - x0, y1 - y0
        fit = profiles.surface_line(session.sim, self.line)
        length = math.hypot(dx, dy)
        rows = [("length", f"{number_text(length)} m, {length / session.sim.bed.diameter:.1f} d")]
        rows.append(("across, up", f"{number_text(abs(dx))}, {number_text(dy if dx >= 0 else -dy)} m"))
        rows.append(("angle", f"{math.degrees(math.atan2(dy if dx >= 0 else -dy, abs(dx))):.1f} degrees"))
        rows.append(("surface", f"{fit['angle']:.1f} degrees, ± {fit['rms']:.2f} d" if fit else "–"))
        return {"ends": list(self.line), "rows": rows, "fit": fit}


def lines_of(found: dict[str, Any]) -> Rows:
    """A grain in words: labels and values."""

    def pair(name: str, unit: str) -> str:
        return f"{number_text(found[name][0])}, {number_text(found[name][1])} {unit}"

    rows = [("kind", f"{found['kind']}{' · fixed' if found['fixed'] else ''}"), ("radius", f"{number_text(1e3 * found['radius'])} mm")]
    if not found["fixed"]:
        rows += [("mass", f"{number_text(found['mass'])} kg"), ("moment of inertia", f"{number_text(found['inertia'])} kg m2")]
    rows += [("place", pair("position", "m")), ("velocity", pair("velocity", "m/s"))]
    rows.append(("speed", f"{number_text(math.hypot(*found['velocity']))} m/s"))
    rows += [("spin", f"{number_text(found['spin'])} rad/s"), ("angle", f"{math.degrees(found['angle']):.0f} degrees")]
    return [*rows, ("contacts", str(len(found["contacts"]))), ("force of all", pair("force", "N"))]


def contact_of(one: dict[str, Any]) -> dict[str, Any]:
    """A contact of a grain: where, the force [N], and in words."""
    text = f"{number_text(one['push'])} N, along {number_text(one['slide'])} N, overlap {one['overlap']:.4f} d"
    return {"point": one["point"], "force": one["force"], "with": one["with"], "text": text}
