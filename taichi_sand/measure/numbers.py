"""The numbers of a report, flat: what goes into a row of a table."""

from typing import Any

TIMINGS = ("wall_time_s", "compile_time_s", "real_time_factor", "ns_per_grain_step", "stages_s", "threads")
"""What of a report differs from run to run of the same scene: left out, so that equal runs are equal files."""


def numbers(report: dict[str, Any]) -> dict[str, float]:
    """The numbers of a report, flat: of a vector [x, y] two. Times that it took, words and flags are left out."""
    found: dict[str, float] = {}
    for name, value in report.items():
        if name in TIMINGS or isinstance(value, bool | str | dict):
            continue
        if isinstance(value, int | float):
            found[name] = float(value)
        elif isinstance(value, list) and len(value) == 2 and all(isinstance(part, int | float) for part in value):
            found[f"{name}_x"], found[f"{name}_y"] = map(float, value)
    return found
