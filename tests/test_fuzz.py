"""Random valid scenes, and files broken at random: nothing lost, nothing infinite, and a sentence instead of a traceback.

Two hundred examples; `python -m taichi_sand.fuzz --examples 5000` draws more. Those of scenes are slow: hypothesis also draws numbers that
it finds in the modules that are loaded, so that other scenes come up whenever a file changes, which is no test of that change.
"""

import pytest

from taichi_sand import fuzz


@pytest.mark.slow
@pytest.mark.parametrize("structure", fuzz.STRUCTURES, ids=lambda structure: "-".join([*structure[:2], *structure[2]]))
def test_random_scenes(structure: tuple[str, str, tuple[str, ...]]) -> None:
    """Finite, nobody lost, energy within the gate, a report in order."""
    fuzz.fuzz_scenes(structure, 17)


def test_broken_scene_files() -> None:
    """Exit 2 with a sentence, or a result."""
    fuzz.fuzz_files(48)


def test_broken_checkpoints() -> None:
    """A checkpoint with any bytes changed is refused, and so are bytes that never were one."""
    fuzz.fuzz_checkpoints(50)
