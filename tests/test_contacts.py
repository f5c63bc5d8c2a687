"""Contacts as rows: against brute force over the places, Newton's second law, and what walls bear."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers import D, G, R, simulate

import taichi_sand as sand
from taichi_sand.measure import structure
from taichi_sand.measure.fields import check
from taichi_sand.measure.grain_state import state_of
from taichi_sand.world import build
from taichi_sand.world.reading import read_columns
from taichi_sand.world.walls.build import standing_walls

FUNNEL = [
    {"points": [[0.0, 0.1], [0.1, 0.0]]},
    {"points": [[0.1, 0.05], [0.15, 0.05]]},
    {"points": [[0.15, 0.05], [0.2, 0.05]]},  # goes on in the one before: one line to the grains
    {"points": [[0.3, 0.1], [0.2, 0.02]]},
]
POURED = {"radius": [0.004, 0.006], "count": 150, "region": [0.01, 0.01, 0.29, 0.39], "fill": "random"}


def forces(rows: np.ndarray) -> np.ndarray:
    """Force on the second grain of each contact [N], (n, 2)."""
    normal = rows["normal"]
    return rows["force_n"][:, None] * normal + rows["force_t"][:, None] * np.stack([-normal[:, 1], normal[:, 0]], axis=1)


def missed(sim: Any) -> tuple[np.ndarray, np.ndarray]:
    """After one more step, of every grain: by how much weight and contact forces miss its mass times acceleration (n, 2), and its mass."""
    before, step = sim.velocities, sim.step
    sim.advance_steps(1)
    assert sim.step == step
    rows, push = sim.contacts(), forces(sim.contacts())
    mass = state_of(sim)["mass"]
    at, grains = np.searchsorted(sim.ids, rows["id1"]), rows["id2"] >= 0
    total = np.zeros((sim.count, 2))
    np.add.at(total, at, -push)
    np.add.at(total, np.searchsorted(sim.ids, rows["id2"][grains]), push[grains])
    total[:, 1] -= mass * G
    return total - mass[:, None] * (sim.velocities - before) / step, mass


def imbalance(sim: Any) -> float:
    """The largest miss after one more step, over the weight of the grain."""
    rest, mass = missed(sim)
    return float((np.abs(rest) / (mass[:, None] * G)).max())


@pytest.fixture(scope="module", params=["md disc", "md triangle", "rigid disc", "rigid triangle"])
def poured(request: pytest.FixtureRequest):
    """Grains among walls that meet: imbalances on the way, and where it comes to rest."""
    kind, shape = request.param.split()
    sim = simulate([{**POURED, "shape": shape}], (0.3, 0.4), {"kind": kind}, gravity=(0, -G), walls=FUNNEL, mu=0.4)
    found = []
    for seconds in (0.15, 0.15, 0.2, 0.5):
        sim.advance(seconds)
        found.append(imbalance(sim))
    return kind, sim, found


def test_rows_are_in_order_and_sound(poured) -> None:
    """By ids, each once, with unit normals and friction within its bound."""
    _, sim, _ = poured
    rows = sim.contacts()
    keys = [tuple(row) for row in rows[["id1", "id2", "disc1", "disc2"]].tolist()]
    walls = rows["id2"] < 0
    assert keys == sorted(keys, key=lambda key: key[:2]) and len(set(keys)) == len(keys)
    assert (rows["id1"] < rows["id2"])[~walls].all() and (rows["disc2"][walls] == -1).all()
    assert np.hypot(*rows["normal"].T) == pytest.approx(1.0, abs=1e-12)
    assert (np.abs(rows["force_t"]) <= 0.4 * rows["force_n"] + 1e-3 * rows["force_n"].max()).all() and rows["force_n"].max() > 0
    assert not rows["bridge"].any() and not rows["couple"].any()


def test_contacts_are_those_of_brute_force(poured) -> None:
    """Overlaps, normals and points of all pairs of discs, from the places alone."""
    _, sim, _ = poured
    table, form = read_columns(sim.world, ("position", "angle", "radius")), sim.scene.form_of(sim.scene.grains[0])
    cos, sin = np.cos(table["angle"]), np.sin(table["angle"])
    radius, discs = table["radius"].astype(float), np.array(form.discs)
    arms = discs[None, :, :2] * radius[:, None, None]
    turned = np.stack(
        [cos[:, None] * arms[..., 0] - sin[:, None] * arms[..., 1], sin[:, None] * arms[..., 0] + cos[:, None] * arms[..., 1]], -1
    )
    x, r = (table["position"][:, None] + turned).reshape(-1, 2), (radius[:, None] * discs[:, 2]).ravel()
    owner = np.repeat(np.arange(sim.count), len(discs))
    gap = np.hypot(*np.moveaxis(x[:, None] - x[None], -1, 0)) - r[:, None] - r[None]
    touching = np.argwhere((gap < 0) & (owner[:, None] < owner[None]))
    rows = sim.contacts()
    rows = rows[(rows["id2"] >= 0) & (rows["overlap"] > 0)]
    one, two = (rows[f"id{k}"] * len(discs) + rows[f"disc{k}"] for k in (1, 2))
    assert {(int(i), int(j)) for i, j in touching} == set(zip(one.tolist(), two.tolist(), strict=True))
    assert rows["overlap"] == pytest.approx(-gap[one, two], abs=1e-14)
    normal = (x[two] - x[one]) / np.hypot(*(x[two] - x[one]).T)[:, None]
    assert rows["normal"] == pytest.approx(normal, abs=1e-5)
    assert rows["point"] == pytest.approx(x[one] + (r[one] + 0.5 * gap[one, two])[:, None] * normal, abs=1e-7)


def test_forces_are_mass_times_acceleration(poured) -> None:
    """Newton's second law for every grain and step, in flight, on impact, and at rest (f64)."""
    _, _, found = poured
    assert max(found) < 1e-10


def test_in_32_bits_only_rounding_is_missed() -> None:
    """Molecular dynamics: forces miss mass times acceleration by half a unit in the last place of the velocity that a step adds to, 7e-5 of
    the weight at 2 m/s; by less than 1e-5 beside that, in flow and at rest.
    """
    sim = simulate([POURED], (0.3, 0.4), {"kind": "md", "precision": 32}, gravity=(0, -G), walls=FUNNEL, mu=0.4)
    for seconds in (0.2, 0.15, 0.15, 0.5):
        sim.advance(seconds)
        before, step = np.abs(sim.velocities), sim.step
        rest, mass = missed(sim)
        unit = np.spacing(np.maximum(before, np.abs(sim.velocities)).astype(np.float32)).astype(float)
        assert (np.abs(rest) <= mass[:, None] * (0.5 * unit / step + 1e-5 * G)).all()


def test_walls_have_their_numbers(poured) -> None:
    """A contact lies on the wall that it names: two that go on in one another are told apart."""
    _, sim, _ = poured
    rows = sim.contacts()
    rows = rows[rows["id2"] < 0]
    assert sim.wall_names() == ["walls[0]", "walls[1]", "walls[2]", "walls[3]", "left", "right", "bottom", "top"]
    edges = [[0, 0], [0, 0.4]], [[0.3, 0], [0.3, 0.4]], [[0, 0], [0.3, 0]], [[0, 0.4], [0.3, 0.4]]
    ends = [np.array(line, float) for line in (*(wall["points"] for wall in FUNNEL), *edges)]
    for row in rows:
        a, b = ends[-1 - row["id2"]]
        share = np.clip((row["point"] - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        assert math.dist(row["point"], a + share * (b - a)) < 1e-4
    assert {-2, -3, -4} <= set(rows["id2"].tolist())


def derivative(values: np.ndarray, step: float, axis: int) -> np.ndarray:
    """Of fourth order, inside; values vanish at the ends."""
    return sum(w * np.roll(values, -k, axis) for k, w in ((1, 2 / 3), (2, -1 / 12), (-1, -2 / 3), (-2, 1 / 12))) / step


def test_fields_hold_mass_momentum_and_stress(poured) -> None:
    """Sums over the grid are those of the grains: mass, momentum, area, Love-Weber stress. Newton's second law of the continuum:
    d(rho V)/dt = rho g - div sigma + what walls push with.
    """
    _, sim, _ = poured
    spacing, width = 0.002, 0.024
    before = sim.fields(spacing, width).momentum.values
    sim.advance_steps(1)
    found, state = sim.fields(spacing, width), state_of(sim)
    cell = spacing**2
    assert float(found.density.sum()) * cell == pytest.approx(state["mass"].sum(), rel=1e-12)
    assert found.momentum.values.sum((0, 1)) * cell == pytest.approx(state["mass"] @ state["velocity"], rel=1e-9, abs=1e-15)
    assert float(found.packing_fraction.sum()) * cell == pytest.approx(state["area"].sum(), rel=1e-12)
    mean = (sim.stresses() * state["area"][:, None, None]).sum(0)
    stress = found.contact_stress.values
    assert stress.sum((0, 1)) * cell == pytest.approx(mean, rel=0.01, abs=1e-9 * np.abs(mean).max())
    assert found.boundary_force.values.sum((0, 1)) * cell == pytest.approx(-sim.wall_forces()["force"].sum(0), rel=1e-9, abs=1e-9)
    div = derivative(stress[..., 0], spacing, 1) + derivative(stress[..., 1], spacing, 0)
    rate, body = (found.momentum.values - before) / sim.step, found.density.values[..., None] * np.array([0.0, -G])
    rest = rate + div - body - found.boundary_force.values
    assert np.sqrt((rest**2).mean()) < 0.02 * np.sqrt((body**2).mean())
    assert (found.kinetic_stress.values[..., [0, 1], [0, 1]] >= -1e-12).all()
    assert found.velocity.dims == ("y", "x", "i") and found.x.values[0] < 0 < found.x.values[-1] - 0.3


def test_stress_above_the_floor_is_the_load(poured) -> None:
    """Through every level goes the weight of what lies above, but for what walls bear there; all walls together bear all."""
    _, sim, _ = poured
    spacing = 0.0025
    found, walls, mass = sim.fields(spacing, 0.01), sim.wall_forces(), state_of(sim)["mass"].sum()
    level = (found.density * G - found.boundary_force.sel(i="y")).sum("x") * spacing**2
    weight = level[::-1].cumsum("y")[::-1] - 0.5 * level
    load = found.contact_stress.sel(i="y", j="y").sum("x") * spacing
    inside = (found.y > 0.05) & (found.y < 0.12)
    assert load[inside].values == pytest.approx(weight[inside].values, abs=0.02 * mass * G)
    assert walls["force"][:, 1].sum() == pytest.approx(-mass * G, rel=0.01) and walls["contacts"].sum() > 20
    assert list(walls["name"]) == sim.wall_names()
    told = sim.report()["wall_forces_N"]
    assert told == {str(row["name"]): [*row["force"], row["torque"]] for row in walls if row["contacts"]} and "bottom" in told
    rows = sim.contacts()
    rows = rows[rows["id2"] == -1]
    arm, push = rows["point"] - [0.05, 0.05], forces(rows)
    assert walls["torque"][0] == pytest.approx((arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]).sum(), rel=1e-9)


def test_order_is_that_of_freud(poured) -> None:
    """psi6 over our contacts, and the number of contacts."""
    freud = pytest.importorskip("freud", reason="freud-analysis has no wheel for this Python")
    _, sim, _ = poured
    rows = sim.contacts()
    rows = rows[(rows["id2"] >= 0) & (rows["overlap"] > 0)]
    pairs = np.unique(np.stack([rows["id1"], rows["id2"]], axis=1), axis=0)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort(both.T[::-1])]
    box = freud.box.Box(6 * D, 6 * D, is2D=True)  # it wraps ways in 32 bits: as exact as the box is small
    places = np.column_stack([sim.positions - [0.15, 0.2], np.zeros(sim.count)])
    near = freud.locality.NeighborList.from_arrays(sim.count, sim.count, both[:, 0], both[:, 1], places[both[:, 1]] - places[both[:, 0]])
    theirs = freud.order.Hexatic(k=6).compute((box, places), neighbors=near).particle_order
    found = sim.hexatic()
    touched = np.bincount(both[:, 0], minlength=sim.count) > 0
    assert np.abs(found[touched] - theirs[touched]).max() < 1e-5 and (found[~touched] == 0).all()
    assert (sim.coordination() >= 0).all() and sim.coordination().sum() >= len(both)


def test_energies_add_up(poured) -> None:
    """To those of the report; the elastic one is that of springs that bear the weight."""
    kind, sim, _ = poured
    found, report = sim.energies(), sim.report()
    assert found["kinetic"].sum() + found["rotational"].sum() == pytest.approx(report["kinetic_energy_J"], rel=1e-9, abs=1e-15)
    assert found["potential"].sum() == pytest.approx(report["potential_energy_J"], rel=1e-9)
    assert ("elastic" in found) == (kind == "md")
    if kind == "md":
        rows = sim.contacts()
        normal = 0.5 * (np.maximum(rows["overlap"], 0.0) * rows["force_n"]).sum()  # at rest the dashpots do nothing
        along = 0.5 * np.abs(rows["history"] * rows["force_t"]).sum()
        assert found["elastic"].sum() == pytest.approx(normal + along, rel=0.01)


@pytest.mark.parametrize("given", [{"spacing": 0.0}, {"spacing": 0.01, "width": 0.005}, {"spacing": "fine"}, {"spacing": 1e-9}])
def test_wrong_fields_are_refused(given: dict[str, Any]) -> None:
    """In a sentence."""
    with pytest.raises(sand.SandError, match=r"fields\("):
        check(*(given.get(name, 0.01) for name in ("spacing", "width")), (0.3, 0.4))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_walls_that_move_and_turn(kind: str) -> None:
    """Contacts with them: numbers, places, and Newton's second law."""
    walls = [
        FUNNEL[0],
        {"points": [[0.1, 0.05], [0.2, 0.05], [0.2, 0.06]], "spin": 2.0},
        {"points": [[0.3, 0.1], [0.2, 0.02]], "velocity": [0, 0.02]},
    ]
    sim = simulate([POURED], (0.3, 0.4), {"kind": kind}, gravity=(0, -G), walls=walls, mu=0.4)
    for _ in range(5):
        sim.advance(0.15)
        assert imbalance(sim) < 1e-10
    rows = sim.contacts()
    assert {-1, -2, -3} <= set(rows["id2"].tolist())
    for number, points in enumerate(standing_walls(sim.world, sim.scene)):
        for point in rows["point"][rows["id2"] == -1 - number]:
            off = [point - a - np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1) * (b - a) for a, b in pairwise(points)]
            assert min(np.hypot(*np.array(off).T)) < 1e-4


LAYOUTS = [("one", "md"), *(pytest.param(name, kind, marks=pytest.mark.slow) for name in ("strips", "cells") for kind in ("md", "rigid"))]


@pytest.mark.parametrize("layout, kind", LAYOUTS)
def test_all_layouts_give_the_same_contacts(layout: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A periodic box with a boulder and bridges, however it is swept: contacts by brute force; Newton's second law; the floor bears the
    weight.
    """
    monkeypatch.setattr(build, "layout_of", lambda gpu, grains: layout)
    grains = [{**POURED, "count": 300, "region": [0.0, 0.01, 0.4, 0.3]}, {"positions": [[0.2, 0.36, 0.03]]}]
    edges = {"left": "periodic", "right": "periodic", "bottom": "wall", "top": "wall"}
    wet = {"friction": {"mu": 0.3}, "cohesion": {"bond_number": 2.0}, "rolling": {"mu": 0.1}}
    sim = simulate(grains, (0.4, 0.4), {"kind": kind}, gravity=(0, -G), edges=edges, effects=wet)
    sim.advance(0.2)
    assert imbalance(sim) < 1e-10
    sim.advance(0.8)
    rows, x, r = sim.contacts(), sim.positions, sim.radii
    way = x[:, None] - x[None]
    way[..., 0] -= np.round(way[..., 0] / 0.4) * 0.4
    gap = np.hypot(way[..., 0], way[..., 1]) - r[:, None] - r[None]
    pairs = rows[rows["id2"] >= 0]
    found = set(zip(*(pairs[name].tolist() for name in ("id1", "id2")), strict=True))
    assert {(int(i), int(j)) for i, j in np.argwhere(np.triu(gap < 0, 1))} <= found
    assert pairs["overlap"] == pytest.approx(-gap[pairs["id1"], pairs["id2"]], abs=1e-12)
    assert (pairs["bridge"][pairs["overlap"] > 0] == 1).all() and (pairs["overlap"].min() < 0) and pairs["couple"].any()
    assert (rows["point"] >= -1e-12).all() and (rows["point"] <= 0.4 + 1e-12).all()
    pushing, felt = np.maximum(rows["force_n"], 0.0), np.zeros(sim.world.capacity, np.float32)
    structure.force(sim.world, felt)
    total = np.bincount(rows["id1"], pushing, sim.count) + np.bincount(pairs["id2"], pushing[rows["id2"] >= 0], sim.count)
    assert felt[: sim.count] == pytest.approx(total[sim.world.grains.id.to_numpy()[: sim.count]], rel=1e-5, abs=1e-5 * total.max())
    walls = rows["id2"] < 0
    assert set(rows["id2"][walls].tolist()) == {-3} and sim.wall_names()[2] == "bottom"
    weight = 2650 * math.pi * (r**2).sum() * G
    assert forces(rows)[walls].sum(axis=0) == pytest.approx([0.0, -weight], abs=0.02 * weight)


@pytest.mark.slow
def test_sleepers_have_contacts() -> None:
    """What fell asleep carries what it did."""
    grains = [{**POURED, "count": 100, "region": [0.01, 0.01, 0.14, 0.39]}]
    sim = simulate(
        grains, (0.15, 0.4), {"kind": "rigid", "precision": 32}, gravity=(0, -G), mu=0.4, effects={"friction": {}, "sleeping": {}}
    )
    sim.advance(4.0)
    assert sim.report()["grains_asleep"] == 100
    rows = sim.contacts()
    weight = 2650 * math.pi * (sim.radii**2).sum() * G
    assert -forces(rows)[rows["id2"] < 0].sum(axis=0)[1] == pytest.approx(weight, rel=0.01)


def test_nobody_touches() -> None:
    """An empty array of the same type, before a step too."""
    sim = sand.Simulation(sand.Scene(size=[0.1, 0.1], solver={"kind": "md"}, grains=[{"positions": [[0.05, 0.05, R]]}]), threads=1)
    assert len(sim.contacts()) == 0 and sim.contacts().dtype.names[:2] == ("id1", "id2")
