"""Random valid scenes, and files broken at random: nothing lost, nothing infinite, and a sentence instead of a traceback.

Two hundred examples; `python -m taichi_sand.fuzz --examples 5000` draws more.
"""

from pathlib import Path

import pytest

from taichi_sand import fuzz


@pytest.mark.parametrize("structure", fuzz.STRUCTURES, ids=lambda structure: "-".join([*structure[:2], *structure[2]]))
def test_random_scenes(structure: tuple[str, str, tuple[str, ...]]) -> None:
    """Finite, nobody lost, energy within the gate, a report in order."""
    fuzz.fuzz_scenes(structure, 17)


def test_broken_scene_files(tmp_path: Path) -> None:
    """Exit 2 with a sentence, or a result."""
    fuzz.fuzz(lambda toml: fuzz.check_files(tmp_path, toml, fuzz.ROWS), 30, fuzz.broken(fuzz.SAMPLE))
    fuzz.fuzz(lambda rows: fuzz.check_files(tmp_path, b"# no scene" + fuzz.SAMPLE[9:], rows), 18, fuzz.broken(fuzz.ROWS))


def test_broken_checkpoints() -> None:
    """A checkpoint with any bytes changed is refused, and so are bytes that never were one."""
    fuzz.fuzz_checkpoints(50)
