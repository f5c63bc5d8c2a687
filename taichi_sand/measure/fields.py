"""Fields out of grains: coarse graining after I. Goldhirsch, Granular Matter 12, 239 (2010), with Lucy's kernel in two dimensions.

With φ(r) = 5/(π c²) (1 + 3 r/c) (1 - r/c)³ for r < c, 0 beyond:

    density ρ = Σ m φ,  momentum = Σ m v φ,  velocity V = momentum / ρ,
    contact stress σ = Σ over contacts and their grains of - b ⊗ f ∫₀¹ φ(r - r_i - s b) ds,
    kinetic stress = Σ m (v - V) ⊗ (v - V) φ,  granular temperature = trace / 2ρ,  packing = Σ area φ,

b from the centre of the grain to the contact, f the force on it. Compression is positive, stress[i, j] = force along i on a plane that
faces j, and ρ dV/dt = ρ g - ∇·(σ + kinetic) + boundary force. The branch of two discs is the straight line between their centres; that of
clumps bends at the contact, and that of a wall ends there.

At walls nothing is mirrored: grains near one spread over it, so that ρ falls off within c of it, and beyond the box there is a margin of c
in which what has spread lies. What walls and fixed grains push with is a field of its own, `boundary_force` = Σ f φ(r - contact). Where the
box is periodic fields are too. Every spread is divided by its sum over the points of the grid, so that sums over the grid are those of the
grains to rounding, however coarse it is.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_sand.errors import SandError

SAMPLES = 4.0
"""A branch is sampled at Gauss-Legendre points in pieces of c / SAMPLES, two a piece: the line integral is right to 1e-4 then."""
TWO_POINTS = 0.5 / 3**0.5

MASS, MX, MY, XX, XY, YY, AREA, SXX, SXY, SYX, SYY, BX, BY = range(13)
"""Columns of the sums."""
COLUMNS = 13

Rows = ti.types.ndarray(dtype=ti.f64, ndim=2)
Line = ti.types.ndarray(dtype=ti.f64, ndim=1)
Sums = ti.types.ndarray(dtype=ti.f64, ndim=3)


@ti.func
def lucy(square, reach):
    """Lucy's kernel, without its norm, at this squared distance."""
    value = ti.cast(0.0, ti.f64)
    if square < reach * reach:
        share = ti.sqrt(square) / reach
        value = (1.0 + 3.0 * share) * (1.0 - share) ** 3
    return value


@ti.func
def span_of(place, low, step, reach, count, wraps):
    """First and last point of the grid, along one axis, that lie within `reach` of `place`; where it wraps they may lie beyond the ends."""
    first = ti.cast(ti.ceil((place - reach - low) / step), ti.i32)
    last = ti.cast(ti.floor((place + reach - low) / step), ti.i32)
    if wraps == 0:
        first, last = ti.max(first, 0), ti.min(last, count - 1)
    return first, last


@ti.func
def wrapped(k, count):
    """Number of a point that may lie beyond the ends; a remainder takes longer than all else that is done with it."""
    at = k
    if k < 0 or k >= count:
        at = k % count
    return at


@ti.func
def spread(
    sums: ti.template(), grid: ti.template(), shares: ti.template(), wraps_x, wraps_y, x, y, amount: ti.template(), first: ti.template()
):
    """Spreads `amount`, a vector for the columns from `first` on, around (x, y). `grid`: low x, low y, step x, step y, c; `shares` is room
    for what each point gets.
    """
    reach = grid[4]
    y0, y1 = span_of(y, grid[1], grid[3], reach, sums.shape[0], wraps_y)
    total, many = ti.cast(0.0, ti.f64), 0
    for row in range(y0, y1 + 1):
        dy = grid[1] + row * grid[3] - y
        across = ti.sqrt(ti.max(reach * reach - dy * dy, 0.0))
        x0, x1 = span_of(x, grid[0], grid[2], across, sums.shape[1], wraps_x)
        for column in range(x0, x1 + 1):
            dx = grid[0] + column * grid[2] - x
            value = lucy(dx * dx + dy * dy, reach)
            shares[many] = value
            total += value
            many += 1
    if total > 0.0:
        part = amount / total
        many = 0
        for row in range(y0, y1 + 1):
            dy = grid[1] + row * grid[3] - y
            across = ti.sqrt(ti.max(reach * reach - dy * dy, 0.0))
            x0, x1 = span_of(x, grid[0], grid[2], across, sums.shape[1], wraps_x)
            at_y = wrapped(row, sums.shape[0])
            for column in range(x0, x1 + 1):
                at_x = wrapped(column, sums.shape[1])
                for k in ti.static(range(amount.n)):
                    sums[at_y, at_x, first + k] = sums[at_y, at_x, first + k] + shares[many] * part[k]
                many += 1


@ti.kernel
def spread_grains(sums: Sums, grid: Line, shares: Line, wraps_x: ti.i32, wraps_y: ti.i32, grains: Rows):
    """Columns MASS to AREA; a row of `grains` is x, y, mass, velocity x, y, area."""
    ti.loop_config(serialize=True)
    for i in range(grains.shape[0]):
        m, u, v = grains[i, 2], grains[i, 3], grains[i, 4]
        amount = ti.Vector([m, m * u, m * v, m * u * u, m * u * v, m * v * v, grains[i, 5]])
        spread(sums, grid, shares, wraps_x, wraps_y, grains[i, 0], grains[i, 1], amount, MASS)


@ti.kernel
def spread_branches(sums: Sums, grid: Line, shares: Line, wraps_x: ti.i32, wraps_y: ti.i32, branches: Rows):
    """Columns SXX to SYY; a row of `branches` is x, y of the centre, x, y from there to the contact, force x, y on the grain."""
    ti.loop_config(serialize=True)
    for i in range(branches.shape[0]):
        bx, by, fx, fy = branches[i, 2], branches[i, 3], branches[i, 4], branches[i, 5]
        pieces = ti.cast(ti.ceil(ti.sqrt(bx * bx + by * by) / grid[4] * SAMPLES), ti.i32)
        share = -0.5 / ti.max(pieces, 1)
        amount = share * ti.Vector([bx * fx, by * fx, bx * fy, by * fy])
        for k in range(2 * pieces):
            s = (k // 2 + 0.5 + (TWO_POINTS if k % 2 == 1 else -TWO_POINTS)) / pieces
            spread(sums, grid, shares, wraps_x, wraps_y, branches[i, 0] + s * bx, branches[i, 1] + s * by, amount, SXX)


@ti.kernel
def spread_pushes(sums: Sums, grid: Line, shares: Line, wraps_x: ti.i32, wraps_y: ti.i32, pushes: Rows):
    """Columns BX and BY; a row of `pushes` is x, y of a contact, force x, y on the grain."""
    ti.loop_config(serialize=True)
    for i in range(pushes.shape[0]):
        spread(sums, grid, shares, wraps_x, wraps_y, pushes[i, 0], pushes[i, 1], ti.Vector([pushes[i, 2], pushes[i, 3]]), BX)


def points(size: np.ndarray, periodic: tuple[bool, bool], spacing: float, width: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Coordinates of the points along x and y [m], and low x, low y, step x, step y, width for the kernels."""
    axes, steps = [], []
    for side, wraps in zip(size, periodic, strict=True):
        if wraps:
            count = max(1, round(side / spacing))
            step, margin = side / count, 0
        else:
            step, margin = spacing, int(np.ceil(width / spacing))
            count = int(np.ceil(side / spacing - 1e-9)) + 2 * margin
        axes.append((np.arange(count) - margin + 0.5) * step)
        steps.append(step)
    return axes, np.array([axes[0][0], axes[1][0], *steps, width])


def fields(state: dict[str, np.ndarray], rows: np.ndarray, box: dict[str, Any], spacing: float, width: float) -> dict[str, np.ndarray]:
    """The fields, by name, and the coordinates `x` and `y`.

    Args:
        state: of the grains, by id order: id, position, velocity, mass (0 of fixed ones), area.
        rows: their contacts, of type contacts.CONTACT.
        box: size and periodic.
        spacing: of the points [m].
        width: c [m], at least `spacing`.
    """
    axes, grid = points(np.array(box["size"]), box["periodic"], spacing, width)
    wraps = [int(one) for one in box["periodic"]]
    sums, shares = np.zeros((len(axes[1]), len(axes[0]), COLUMNS)), np.empty(int(np.prod(2 * width / grid[2:4] + 2)))
    grains = np.column_stack([state["position"], state["mass"], state["velocity"], state["area"]])
    spread_grains(sums, grid, shares, *wraps, np.ascontiguousarray(grains))
    branches, pushes = branches_of(state, rows, box)
    spread_branches(sums, grid, shares, *wraps, branches)
    spread_pushes(sums, grid, shares, *wraps, pushes)
    sums /= grid[2] * grid[3]
    return {"x": axes[0], "y": axes[1], **named(sums)}


def named(sums: np.ndarray) -> dict[str, np.ndarray]:
    """The fields that are made of the sums over a unit area, (ny, nx, COLUMNS)."""
    density, momentum = sums[..., MASS], sums[..., [MX, MY]]
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity = np.where(density[..., None] > 0, momentum / density[..., None], np.nan)
    moving = np.nan_to_num(velocity)
    second = sums[..., [XX, XY, XY, YY]].reshape(*density.shape, 2, 2)
    kinetic = second - density[..., None, None] * moving[..., :, None] * moving[..., None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        temperature = np.where(density > 0, np.trace(kinetic, axis1=-2, axis2=-1) / (2 * density), np.nan)
    return {
        "density": density,
        "momentum": momentum,
        "velocity": velocity,
        "contact_stress": sums[..., [SXX, SXY, SYX, SYY]].reshape(*density.shape, 2, 2),
        "kinetic_stress": kinetic,
        "granular_temperature": temperature,
        "packing_fraction": sums[..., AREA],
        "boundary_force": sums[..., [BX, BY]],
    }


def branches_of(state: dict[str, np.ndarray], rows: np.ndarray, box: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """What `spread_branches` and `spread_pushes` take: for both grains of every contact that can move; for contacts with what cannot."""
    size, wraps = np.array(box["size"]), np.array(box["periodic"])
    slot = np.searchsorted(state["id"], np.stack([rows["id1"], np.maximum(rows["id2"], 0)], axis=1))
    slot = np.minimum(slot, len(state["id"]) - 1)
    grain = np.stack([np.ones(len(rows), bool), rows["id2"] >= 0], axis=1)
    free = grain & (state["mass"][slot] > 0)
    normal = rows["normal"]
    force = rows["force_n"][:, None] * normal + rows["force_t"][:, None] * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    found, pushed = [], []
    for k, sign in ((0, -1.0), (1, 1.0)):
        mine = free[:, k]
        centre, point = state["position"][slot[mine, k]], rows["point"][mine]
        branch = point - centre
        branch -= np.where(wraps, np.round(branch / size) * size, 0.0)
        found.append(np.concatenate([centre, branch, sign * force[mine]], axis=1))
        edge = mine & ~free[:, 1 - k]
        pushed.append(np.concatenate([rows["point"][edge], sign * force[edge]], axis=1))
    return np.concatenate(found), np.concatenate(pushed)


UNITS = {
    "x": "m",
    "y": "m",
    "density": "kg/m2",
    "momentum": "N s/m2",
    "velocity": "m/s",
    "contact_stress": "N/m",
    "kinetic_stress": "N/m",
    "granular_temperature": "m2/s2",
    "packing_fraction": "",
    "boundary_force": "N/m2",
}


def as_dataset(found: dict[str, np.ndarray], **attributes: Any) -> Any:
    """An xarray.Dataset of the fields, or the dictionary as it is where xarray is not installed."""
    try:
        import xarray
    except ImportError:
        return found
    dims = ("y", "x", "i", "j")
    data = {name: (dims[: values.ndim], values, {"units": UNITS[name]}) for name, values in found.items() if name not in ("x", "y")}
    coords = {name: (name, found[name], {"units": "m"}) for name in ("x", "y")}
    return xarray.Dataset(data, {**coords, "i": ["x", "y"], "j": ["x", "y"]}, attributes)


def check(spacing: Any, width: Any, size: tuple[float, float]) -> None:
    """SandError unless fields can be had with these [m]."""
    for name, value in (("spacing", spacing), ("width", width)):
        if not isinstance(value, int | float | np.integer | np.floating) or isinstance(value, bool) or not 0 < value < np.inf:
            raise SandError(f"fields({name}={value!r}): must be a length above 0 [m]")
    if width < spacing:
        raise SandError(f"fields(width={width:g}): must be at least the spacing, {spacing:g} m")
    if (count := np.prod([side / spacing + 2 for side in size])) > MOST_POINTS:
        raise SandError(f"fields(spacing={spacing:g}): makes {count:.3g} points; at most {MOST_POINTS} can be had")


MOST_POINTS = 4_000_000
