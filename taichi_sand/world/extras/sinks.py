"""Where grains come from and go to while the simulation runs, as the kernels know it: sinks take grains out in every list build."""

from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from taichi_sand.taichi_support import field_pool


class Flow(NamedTuple):
    """Tables of a world with [[sources]] or [[sinks]]."""

    made: Any  # grains that each source has made, shape (sources,), i32
    sink: Any  # x0, y0, x1, y1 of each sink [m], 4-vectors; one of no size if there is none
    sunk: Any  # 0-D i32: grains that sinks have taken


def build_flow(scene: Any, real: Any) -> dict[str, Any]:
    """What the World has of the sources and sinks of `scene`."""
    if not scene.sources and not scene.sinks:
        return {"flow": None, "flows": False}
    regions = [sink.region for sink in scene.sinks] or [(0.0, 0.0, -1.0, -1.0)]
    flow = Flow(
        field_pool.scalars(ti.i32, max(1, len(scene.sources))), field_pool.vectors(4, real, len(regions)), field_pool.scalars(ti.i32, ())
    )
    flow.sink.from_numpy(np.array(regions, np.float64 if real == ti.f64 else np.float32))
    return {"flow": flow, "flows": True}


@ti.func
def drain(w: ti.template(), i, p):
    """Takes grain i, at p, out if its centre is in a sink and it can move; the list build then drops it."""
    for k in range(w.flow.sink.shape[0]):
        box = w.flow.sink[k]
        within = p.x >= box.x and p.y >= box.y and p.x <= box.z and p.y <= box.w
        if within and w.grains.id[i] >= 0 and w.grains.mobility[i].x > 0.0:
            w.grains.id[i] = -1
            w.flow.sunk[None] += 1
