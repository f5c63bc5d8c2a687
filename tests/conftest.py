"""Shared by all tests: Taichi keeps quiet, and compiles fast where a test takes seconds."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("NO_COLOR", "1")  # messages without control characters


LONG = (
    "test_bonds.py::test_bonds_in_the_window",
    "test_bonds.py::test_stiff_bonds_are_stable[rigid-0.1]",
    "test_bonds.py::test_stiff_bonds_are_stable[md-0.1]",
    "test_bonds.py::test_stiff_bonds_are_stable[rigid-1.0]",
    "test_bonds.py::test_frequency_of_a_pair[rigid]",
    "test_boulders.py::test_no_contact_is_missed[rigid-cells]",
    "test_boulders.py::test_a_boulder_is_pushed_as_any_grain[rigid]",
    "test_clumps.py::test_static_threshold[rigid]",
    "test_clumps.py::test_conservation[rigid]",
    "test_columns.py::test_md_bounces_lower",
    "test_columns.py::test_rigid_column[100-270.0]",
    "test_conservation.py::test_md_gas[linear-20]",
    "test_dial.py::test_what_presses_on_a_pile_is_seen_by_its_overlaps[md]",
    "test_effects.py::test_neutral_values_change_nothing[rigid]",
    "test_moving_walls.py::test_piston_stops_where_grains_bear_its_force[md]",
    "test_moving_walls.py::test_lifts_off_above_one_g[0.9-",
    "test_moving_walls.py::test_turning_wall_drags_with_its_surface[md]",
    "test_fields.py::test_nothing_of_the_one_before_is_left[rigid]",
    "test_search.py::test_lone_fast_disc_meets_the_walls[md-gravity0]",
    "test_session.py::test_whoever_slept_moves_on",
    "test_sleeping.py::test_clumps_sleep_and_wake[rigid]",
    "test_sleeping.py::test_a_moving_wall_wakes[rigid]",
    "test_sleeping.py::test_a_sleeping_pile_does_not_move_a_bit[md]",
    "test_sleeping.py::test_falling_asleep_and_waking_costs_no_energy[rigid]",
    "test_sleeping.py::test_strips_sleep_to_the_same_bits",
    "test_sleeping.py::test_waking_a_few_changes_nothing_else[rigid]",
    "test_stress.py::test_hard_case[elastic-",
)
"""Slow by what they compile, or simulate; most have a like for the other solver that is not."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks those as slow, before `-m` chooses."""
    for item in items:
        if any(name in item.nodeid for name in LONG):
            item.add_marker(pytest.mark.slow)


def pytest_configure(config: pytest.Config) -> None:
    """Most of what the quick tests take is compiling: without Taichi's own optimiser it takes two thirds of the time, and a step a tenth
    more. The slow ones run the kernels that users run.
    """
    if config.option.markexpr == "not slow":
        os.environ.setdefault("TI_ADVANCED_OPTIMIZATION", "0")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--arch cuda` runs tests/test_cells.py on a GPU."""
    parser.addoption("--arch", default="cpu", help="backend for the tests of the layout that a GPU runs on")


@pytest.fixture(scope="module", autouse=True)
def nobody_elses_simulation() -> None:
    """Fixtures of another file may still hold theirs, on other threads or of other precision."""
    from taichi_sand.study.laboratory import fresh_taichi

    fresh_taichi()


@pytest.fixture
def scene_file(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a scene file, `scene.toml` in a folder of its own, and returns its path."""

    def write(text: str | bytes) -> Path:
        path = tmp_path / "scene.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write
