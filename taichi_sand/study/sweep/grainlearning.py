"""A sweep in the files that GrainLearning reads: a table of the samples, and of every run its series and its parameters."""

from pathlib import Path

import numpy as np

from taichi_sand.errors import SandError
from taichi_sand.files import writing
from taichi_sand.study.sweep.plan import Plan
from taichi_sand.study.sweep.plot import numeric
from taichi_sand.study.sweep.store import Store

ITERATION = 0


def export(plan: Plan, store: Store, folder: Path, name: str = "taichi_sand") -> int:
    """Writes `folder`/iter0/NAME_Iter0_Sample<k>_sim.txt and _param.txt for every run with a series, and the table of all samples
    beside them, as GrainLearning's IODynamicSystem takes them with sim_data_file_ext ".txt"; returns how many runs these are.

    The names of parameters and numbers are those of the sweep, dots as underscores.

    Raises:
        SandError: a key is varied over words, or no run has a series (`every`).
    """
    words = [key for key, values in plan.vary.items() if not numeric(values)]
    if words:
        raise SandError(f"GrainLearning knows numbers only: {words[0]} is varied over words")
    jobs = [job for job in plan.jobs if (store.place(job) / "series.csv").is_file()]
    if not jobs:
        raise SandError("GrainLearning compares series in time: run the sweep with --every")
    parameters = [key.replace(".", "_") for key in plan.vary] + ["seed"]
    with writing.replacing(folder / f"iter{ITERATION}", folder=True) as target:
        target.mkdir()
        samples = []
        digits = len(str(max(len(jobs) - 1, 1)))
        for number, job in enumerate(jobs):
            values = [float(value) for value in job.values.values()]
            stem = f"{name}_Iter{ITERATION}_Sample{number:0{digits}}"
            head, *_ = (store.place(job) / "series.csv").read_text("utf-8").splitlines()
            series = np.loadtxt(store.place(job) / "series.csv", delimiter=",", skiprows=1, ndmin=2)
            np.savetxt(target / f"{stem}_sim.txt", series, header=" ".join(head.split(",")))
            np.savetxt(target / f"{stem}_param.txt", [values], header=" ".join(parameters))
            samples.append(f"1 {stem} {number} " + " ".join(f"{value:.10e}" for value in values))
        table = " ".join(["!OMP_NUM_THREADS", "description", "key", *parameters])
        (target / f"{name}_Iter{ITERATION}_Samples.txt").write_text("\n".join([table, *samples, ""]), "utf-8")
    return len(jobs)
