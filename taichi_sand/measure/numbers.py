"""The numbers of a report, flat: what goes into a row of a table."""

from typing import Any

import numpy as np

WALLS = {
    "wall_forces_N": ("wall_forces_N.{}_x", "wall_forces_N.{}_y", "wall_torques_Nm.{}"),
    "wall_pressures_N_m": ("wall_pressures_N_m.{}",),
}
"""Tables of the report with a row for each wall, and what the numbers of a row are called."""
TIMINGS = ("wall_time_s", "compile_time_s", "real_time_factor", "ns_per_grain_step", "stages_s", "threads")
"""What of a report differs from run to run of the same scene: left out, so that equal runs are equal files."""


def numbers(report: dict[str, Any]) -> dict[str, float]:
    """The numbers of a report, flat: of a vector [x, y] two, of every wall its force, torque and pressure by its name. Times that it took,
    words and flags are left out.
    """
    found: dict[str, float] = {}
    for name, value in report.items():
        for wall, row in value.items() if name in WALLS else ():
            found |= {form.format(wall): float(number) for form, number in zip(WALLS[name], np.ravel(row), strict=True)}
        if name in TIMINGS or isinstance(value, bool | str | dict):
            continue
        if isinstance(value, int | float):
            found[name] = float(value)
        elif isinstance(value, list) and len(value) == 2 and all(isinstance(part, int | float) for part in value):
            found[f"{name}_x"], found[f"{name}_y"] = map(float, value)
    return found
