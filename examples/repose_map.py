"""The angle of repose of a heap over friction and rolling resistance, as a map: a sweep, and its plot.

    python examples/repose_map.py [FOLDER] [SEEDS]

Results are kept in FOLDER: broken off, it goes on where it was. Two minutes on two cores.
"""

import sys
from pathlib import Path

import taichi_sand as sand
from taichi_sand.study.sweep.plot import plot

FRICTION, ROLLING = "0.1..0.9:5", "0..0.15:4"


def main(folder: Path, seeds: int = 3, friction: str = FRICTION, rolling: str = ROLLING, overrides: tuple[str, ...] = ()) -> None:
    """Sweeps, draws FOLDER/repose_map.png and prints the means [degrees]."""
    vary = {"effects.rolling.mu": rolling, "effects.friction.mu": friction}
    found = sand.sweep(sand.load("pile", overrides), vary, seeds, measures=["repose_angle"], folder=folder)
    plot(found, "repose_angle", folder / "repose_map.png")
    print(found.repose_angle.mean("seed").round(1).to_pandas().to_string())


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "repose"), int(sys.argv[2]) if len(sys.argv) > 2 else 3)
