"""What a simulation takes over from one that is gone: its fields, cleared, and the kernels compiled for them."""

import gc

import numpy as np
import pytest
import taichi as ti
from helpers import D, Disc, G, R, digest, fresh_taichi, simulate

import taichi_sand as sand
from taichi_sand.measure.report import cost
from taichi_sand.taichi_support import field_pool, runtime
from taichi_sand.taichi_support.runtime import compiled

KINDS = {
    "md": {"shape": "triangle", "effects": {"friction": {"mu": 0.5}, "heat": {"conduction": 10.0}}},
    "rigid": {"shape": "disc", "effects": {"friction": {"mu": 0.5}, "sleeping": {}}},
}


def heap(kind: str, shape: str, effects: dict, velocity: tuple = (0.0, 0.0)) -> sand.Scene:
    """Sixty grains fall on a floor."""
    grains = [{"shape": shape, "radius": R, "count": 60, "fill": "lattice", "pitch": 1.2, "velocity": velocity}]
    return sand.Scene(size=[0.2, 0.3], gravity=(0.0, -G), solver={"kind": kind}, grains=grains, effects=effects)


def end_of(scene: sand.Scene) -> tuple[str, dict]:
    """State and report of a scene after a while."""
    sim = sand.Simulation(scene, threads=1)
    sim.advance(0.1)
    return digest(sim), {key: value for key, value in sim.report().items() if key not in cost(sim)}


@pytest.mark.parametrize("kind", ["md", "rigid"])
def test_nothing_of_the_one_before_is_left(kind: str) -> None:
    """A scene gives the same bits and report in fields that others have had, and nothing is compiled for it."""
    runtime.forget()
    first = end_of(heap(kind, **KINDS[kind]))
    end_of(heap(kind, "disc", {}))  # asks for other fields
    end_of(heap(kind, **KINDS[kind], velocity=(0.5, 0.0)))  # in those of the first
    made = compiled()
    second = end_of(heap(kind, **KINDS[kind]))
    assert compiled() == made
    assert second == first


def test_those_in_use_are_not_shared() -> None:
    """Two simulations at a time have fields each, and go the same way."""
    fresh_taichi()
    scene = sand.Scene(size=[0.2, 0.3], grains=[{"radius": R, "count": 60, "fill": "lattice", "pitch": 1.2}])
    one, two = sand.Simulation(scene, threads=1), sand.Simulation(scene, threads=1)
    one.advance(0.05)
    assert one.world is not two.world and one.world.grains.shift is not two.world.grains.shift
    assert not np.array_equal(one.positions, two.positions)
    two.advance(0.05)
    assert digest(one) == digest(two)
    world = one.world
    del one
    gc.collect()
    assert sand.Simulation(scene, threads=1).world is world


def test_every_kind_of_field_is_cleared() -> None:
    """All numbers of fields of every make, and none of their neighbours'."""
    fresh_taichi()
    keeper = simulate([Disc(0.05, 0.05)], (0.1, 0.1), {"kind": "md"})  # starts Taichi

    class User:
        pass

    struct = ti.types.struct(a=ti.f32, b=ti.types.vector(2, ti.f64), c=ti.i32)
    makers = [
        lambda: field_pool.scalars(ti.i32, 5),
        lambda: field_pool.vectors(3, ti.f64, 7),
        lambda: field_pool.vectors(4, ti.f32, 9, layout=ti.Layout.SOA),
        lambda: field_pool.scalars(ti.f32, (3, 4)),
    ]

    def numbers(made: list) -> list[np.ndarray]:
        record = made[-1][None]
        return [field.to_numpy() for field in made[:-1]] + [np.array([record.a, *record.b.to_list(), record.c])]

    def ask(user: User) -> list:
        made: list = []
        field_pool.borrow(user, lambda: made.__init__([make() for make in makers] + [field_pool.record(struct)]), keep=True)
        return made

    one, two = User(), User()
    made, others = ask(one), ask(two)
    for group, value in ((made, 3), (others, 7)):
        for field in group[:-1]:
            field.fill(value)
        group[-1][None] = {"a": value, "b": [value, value], "c": value}
    del one
    three = User()
    again = ask(three)
    assert all(a is b for a, b in zip(again, made, strict=True))
    assert all((values == 0).all() for values in numbers(again))
    assert all((values == 7).all() for values in numbers(others))
    assert keeper.count == 1 and two is not three


def test_same_only_if_all_is_the_same() -> None:
    """Numbers of another type, other fields, and things that may change are not the same."""
    from dataclasses import dataclass, make_dataclass

    Frozen = make_dataclass("Frozen", ["a", "b"], frozen=True, eq=False)

    @dataclass
    class Changing:
        a: int

    assert field_pool.same(Frozen(1, (2.0, "x"))) is field_pool.same(Frozen(1, (2.0, "x")))
    for other in (Frozen(True, (2.0, "x")), Frozen(1, (2, "x")), Frozen(1, (2.0, "y")), Frozen(1, [2.0, "x"])):
        assert field_pool.same(other) is other
        assert field_pool.same(other) is not field_pool.same(Frozen(1, (2.0, "x")))
    assert field_pool.same(Changing(1)) is not field_pool.same(Changing(1))
    assert field_pool.same(Frozen(D, None)) is not field_pool.same(Frozen(-D, None))
