"""Random valid scenes, and files broken at random: nothing lost, nothing infinite, and a sentence instead of a traceback.

Some two hundred examples, the same ones until fuzzing.py or hypothesis change; `python tests/fuzzing.py --examples 5000` draws others.
"""

from collections.abc import Iterator

import fuzzing as fuzz
import pytest
from hypothesis.internal.conjecture import providers


@pytest.fixture(autouse=True, scope="module")
def own_draws() -> Iterator[None]:
    """Hypothesis also draws numbers that it finds in the modules that are loaded: any edit would change what is tried. Not here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(providers, "_get_local_constants", providers.Constants)
        patch.setattr(providers, "CONSTANTS_CACHE", {})
        yield


@pytest.mark.parametrize("structure", fuzz.STRUCTURES, ids=lambda structure: "-".join([*structure[:2], *structure[2]]))
def test_random_scenes(structure: tuple[str, str, tuple[str, ...]]) -> None:
    """Finite, nobody lost, energy within the gate, a report in order."""
    fuzz.fuzz_scenes(structure, 17)


def test_broken_scene_files() -> None:
    """Exit 2 with a sentence, or a result."""
    fuzz.fuzz_files(48)


def test_broken_checkpoints() -> None:
    """Refused, or gone on from without harm: with any bytes changed, or with any numbers and a hash that fits."""
    fuzz.fuzz_checkpoints(48)


def test_broken_recordings() -> None:
    """Refused, or done again as far as they go."""
    fuzz.fuzz_recordings(36)
