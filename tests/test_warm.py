"""`warm` compiles ahead."""

import os
import subprocess
import sys
from pathlib import Path


def test_what_is_warm_is_not_compiled_again(tmp_path: Path) -> None:
    """Once a scene is warm, neither `warm` nor `run` adds a kernel to Taichi's cache."""
    environment = os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / "cache")}
    filed = []
    for words in (["warm", "newton_cradle", "--play"], ["run", "newton_cradle", "--seconds", "0.1"], ["warm", "newton_cradle"]):
        done = subprocess.run([sys.executable, "-m", "taichi_sand", *words], env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        filed.append(sorted(path.name for path in (tmp_path / "cache").rglob("*.tic")))
    assert filed[0] and filed[0] == filed[1] == filed[2]
