"""Parameter studies: what they plan, that they can be broken off anywhere, and that where they run makes no difference."""

import csv
import json
import multiprocessing
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import taichi_sand as sand
from taichi_sand.study.sweep import calibrate as search
from taichi_sand.study.sweep import engine, job, local, plan, results, specs, store

ROOT = Path(sand.__file__).parents[1]
MU = "effects.friction.mu"
SMALL = ["scale=0.05", "duration=0.1"]
"""settle with 50 grains."""


def small(vary: dict, seeds: int = 1, **asked: object) -> plan.Plan:
    return plan.plan(engine.loader("settle", (), SMALL), vary, seeds, plan.Asked(**asked))


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.1,0.2,0.5", [0.1, 0.2, 0.5]),
        ("0..1:5", [0.0, 0.25, 0.5, 0.75, 1.0]),
        ("log:0.001..0.1:3", [0.001, 0.01, 0.1]),
        ("md,rigid", ["md", "rigid"]),
        ("[0.0, -9.81],[1.0, -9.81]", [[0.0, -9.81], [1.0, -9.81]]),
        ("1..2:2", [1.0, 2.0]),
        ("true,false", [True, False]),
    ],
)
def test_what_a_spec_means(text: str, values: list) -> None:
    assert specs.parse(f"a.b={text}") == ("a.b", values)


@pytest.mark.parametrize("text", ["", "a", "a=", "a=0..1:1", "a=0..b:3", "a=log:0..1:3", "a=1,1", "a=1,,2", "a=0..inf:3", "a=0..1:9999999"])
def test_a_spec_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(sand.SandError, match="vary"):
        specs.parse(text)


def test_a_key_is_that_of_what_decides_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    first = small({MU: [0.1]}).jobs[0]
    assert small({MU: [0.1]}).jobs[0].key == first.key
    others = [
        small({MU: [0.2]}).jobs[0],
        small({MU: [0.1]}, seconds=0.2).jobs[0],
        small({MU: [0.1]}, every=0.05).jobs[0],
        small({MU: [0.1]}, arch="cuda").jobs[0],
        small({MU: [0.1], "solver.precision": [64]}).jobs[0],
        small({MU: [0.1]}, seeds=2).jobs[1],
    ]
    monkeypatch.setattr(sand, "__version__", "other")
    others.append(small({MU: [0.1]}).jobs[0])
    assert len({first.key, *(one.key for one in others)}) == 1 + len(others)


def test_a_thousand_runs_are_planned_within_a_second() -> None:
    small({MU: [0.1]})  # imports
    start = time.process_time()
    made = small({MU: list(np.linspace(0, 1, 100)), "solver.restitution": [0.1, 0.2]}, seeds=5)
    assert len({one.key for one in made.jobs}) == 1000
    assert time.process_time() - start < 1.0


def test_a_sweep_is_a_table_and_an_array(tmp_path: Path) -> None:
    """A refused scene costs its row; what there is, is not done again; the numbers are those of a run of its own."""
    import xarray

    asked = {"scene": sand.load("settle", SMALL), "vary": {MU: [0.1, -1.0]}, "seeds": 2, "folder": tmp_path, "workers": 1, "every": 0.05}
    found = sand.sweep(**asked)
    assert found.sizes == {MU: 2, "seed": 2}
    assert (found.status.values == [["done", "done"], ["refused", "refused"]]).all()
    assert np.isnan(found.overlap_mean.sel({MU: -1.0})).all()
    assert found.floor_force_N.attrs["units"] == "N" and found.overlap_max.attrs["units"] == "d"
    before = files_of(tmp_path)
    sand.sweep(**asked)
    assert files_of(tmp_path) == before
    stored = xarray.load_dataset(tmp_path / "sweep.nc", engine="scipy")
    assert (stored.floor_force_N.values == found.floor_force_N.values)[0].all()
    with (tmp_path / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 and rows[2]["floor_force_N"] == "" and "must lie in" in rows[2]["sentence"]
    scene = sand.load(tmp_path / "runs" / rows[1]["run"] / "scene.toml")
    sim = sand.Simulation(scene, threads=1)
    for _ in range(2):
        sim.advance(0.05)
    assert sim.report()["kinetic_energy_J"] == float(rows[1]["kinetic_energy_J"])
    series = (tmp_path / "runs" / rows[1]["run"] / "series.csv").read_text().splitlines()
    assert len(series) == 1 + 3 and [float(row.split(",")[0]) for row in series[1:]] == pytest.approx([0.0, 0.05, 0.1], abs=2e-3)


POISON = """
import os, time
from taichi_sand.effects import Effect
from taichi_sand.scene.parameters import Parameter
class Poison(Effect):
    parameters = (Parameter("bad", "no", "what goes wrong", choices=("no", "crash", "error", "hang"), live=False),)
    interval = 0.01
    @classmethod
    def build(cls, values, columns, solver):
        if values["bad"] == "crash": os.kill(os.getpid(), 11)
        if values["bad"] == "error": raise ValueError("poison")
        if values["bad"] == "hang": time.sleep(60)
        return cls()
    def on_pause(self, world, solver): pass
"""
"""An effect of the user's own that goes wrong as a simulation is made."""


def test_runs_that_break_cost_a_row_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A crash, an error, a hang: the others are done; `retry_failed` would do these again."""
    monkeypatch.setattr(local, "GRACE", 1.0)
    (tmp_path / "poison.py").write_text(POISON)
    scene, effects = tmp_path / "scene.toml", [tmp_path / "poison.py"]
    scene.write_text("size = [0.1, 0.1]\nduration = 0.05\n[[grains]]\npositions = [[0.05, 0.05, 0.005]]\n[effects.poison]\n")
    vary = {"effects.poison.bad": ["no", "crash", "error", "hang"]}
    asked = {"folder": tmp_path / "out", "workers": 1, "effects": effects}
    sand.sweep(scene, {"effects.poison.bad": ["no"]}, **asked)  # compiles, in no hurry
    found = sand.sweep(scene, vary, timeout=8.0, **asked)
    assert found.status.values[:, 0].tolist() == ["done", "crashed", "error", "timeout"]
    for number, sentence in enumerate(("signal 11", "ValueError: poison", "longer than 8 s"), 1):
        assert sentence in str(found.sentence.values[number, 0])
    made = plan.plan(engine.loader(scene, effects), vary, 1, plan.Asked(own=engine.own_sources(effects)))
    assert len(engine.due(made, store.Store(tmp_path / "out"), True)) == 3


def command(*words: str | Path, **more: object) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, "-m", "taichi_sand", *map(str, words)],
        env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **more,
    )  # fmt: skip


SWEEP = ["settle", "--set", "scale=0.05", "--seconds", "0.05", "--vary", f"{MU}=0.1..0.5:4", "--seeds", "3"]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    done = command("sweep", *SWEEP, "-o", folder, "--workers", "1")
    assert done.communicate()[0].startswith("12 runs: 12 done") and done.returncode == 0
    return folder


def test_killed_in_the_middle_it_goes_on_to_the_same_files(undisturbed: Path, tmp_path: Path) -> None:
    """Of the command and of a worker, by kill -9."""
    first = command("sweep", *SWEEP, "-o", tmp_path, "--workers", "2", start_new_session=True)
    while len(list((tmp_path / "runs").glob("[0-9a-f]*"))) < 2:
        assert first.poll() is None
        time.sleep(0.02)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    assert not (tmp_path / "sweep.csv").exists()
    second = command("sweep", *SWEEP, "-o", tmp_path, "--workers", "2")
    killed = threading.Thread(target=kill_a_worker, args=(second.pid,))
    killed.start()
    assert second.communicate()[0].startswith("12 runs: 12 done") and second.returncode == 0
    killed.join()
    assert files_of(tmp_path) == files_of(undisturbed)


def kill_a_worker(parent: int) -> None:
    for _ in range(200):
        found = subprocess.run(["pgrep", "-P", str(parent), "-f", "spawn_main"], capture_output=True, text=True, check=False).stdout.split()
        if found:
            time.sleep(1.0)
            os.kill(int(found[0]), signal.SIGKILL)
            return
        time.sleep(0.05)


def test_written_commands_give_the_same_files(undisturbed: Path, tmp_path: Path) -> None:
    lines = tmp_path / "commands.txt"
    written = command("sweep", *SWEEP, "-o", tmp_path / "out", "--write-commands", lines)
    assert written.communicate()[0].startswith("12 lines")
    jobs = [shlex.split(line) for line in lines.read_text().splitlines()]
    assert len(jobs) == 12 and all(words[:3] == ["taichi-sand", "sweep", "--run"] for words in jobs)
    assert command(*jobs[0][1:]).wait() == 0
    for words in jobs[1:]:
        engine.run_written(Path(words[3]), None)
    merged = command("sweep", *SWEEP, "-o", tmp_path / "out")
    assert merged.communicate()[0].startswith("12 runs: 12 done")
    found = files_of(tmp_path / "out")
    assert {name: content for name, content in found.items() if not name.startswith("jobs/")} == files_of(undisturbed)


EXECUTORS = {
    "processes": lambda: ProcessPoolExecutor(2, multiprocessing.get_context("spawn")),
    "threads": lambda: ThreadPoolExecutor(2),
}


@pytest.mark.parametrize("kind", EXECUTORS)
def test_any_executor_gives_the_same_files(kind: str, undisturbed: Path, tmp_path: Path) -> None:
    stderr = sys.stderr
    with EXECUTORS[kind]() as executor:
        found = sand.sweep(sand.load("settle", ["scale=0.05"]), {MU: "0.1..0.5:4"}, 3, seconds=0.05, executor=executor, folder=tmp_path)
    assert (found.status == "done").all() and sys.stderr is stderr
    assert (tmp_path / "sweep.csv").read_bytes() == (undisturbed / "sweep.csv").read_bytes()


@pytest.fixture
def dask_cluster(tmp_path: Path) -> Iterator[str]:
    """A scheduler and two workers, each a process of its own."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    address_file = tmp_path / "scheduler.json"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    start = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    processes = [subprocess.Popen([*start, "--scheduler-file", str(address_file)], env=environment, stderr=subprocess.DEVNULL)]
    try:
        for _ in range(300):
            if address_file.exists() and address_file.stat().st_size:
                break
            time.sleep(0.1)
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(address_file), "--nthreads", "1"]
        processes += [
            subprocess.Popen([*worker, "--no-dashboard", "--local-directory", str(tmp_path)], env=environment, stderr=subprocess.DEVNULL)
            for _ in range(2)
        ]
        yield json.loads(address_file.read_text())["address"]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_a_dask_cluster_gives_the_same_files(undisturbed: Path, tmp_path: Path, dask_cluster: str) -> None:
    done = command("sweep", *SWEEP, "-o", tmp_path / "out", "--scheduler", dask_cluster)
    out, error = done.communicate()
    assert out.startswith("12 runs: 12 done"), error
    assert files_of(tmp_path / "out") == files_of(undisturbed)


def test_a_full_disk_ends_in_a_sentence_and_can_be_gone_on_with(undisturbed: Path, tmp_path: Path) -> None:
    """A file-size limit stands for the disk: no file may be larger than 200 bytes."""
    import resource

    words = ["sweep", *SWEEP, "-o", tmp_path, "--workers", "1"]

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200, resource.RLIM_INFINITY))

    full = command(*words, preexec_fn=limit)
    error = full.communicate()[1]
    assert full.returncode == 2 and "cannot be written" in error and "Traceback" not in error
    assert not list((tmp_path / "runs").glob(".*"))
    assert command(*words).wait() == 0
    assert files_of(tmp_path) == files_of(undisturbed)


def test_a_line_that_meets_the_target() -> None:
    """Analytic: 10 + 20 x + noise of 0.5 measures 20 at 0.5; the interval that is stated holds it in at least 90 of 100 cases."""
    rng = np.random.default_rng(1)
    ranges = {"x": search.Range(0.0, 1.0)}
    held = 0
    for _ in range(100):
        trials = [({"x": x}, 10 + 20 * x + rng.normal(0, 0.5)) for x in rng.uniform(0.2, 0.8, 16)]
        found = search.conclude(trials, ranges, 20.0, 1.0)
        assert found and found.sure
        held += abs(found.values["x"] - 0.5) < search.SURE * found.errors["x"]
    assert held >= 85


def test_a_target_that_is_out_of_reach_is_no_success() -> None:
    trials = [({"x": x}, 10 + x) for x in np.linspace(0, 1, 8)]
    assert search.conclude(trials, {"x": search.Range(0.0, 1.0)}, 20.0, 1.0) is None


@pytest.mark.slow
def test_calibration_finds_the_friction_of_a_heap(tmp_path: Path) -> None:
    """A heap of 20 degrees within 1, in under 25 runs; heaps poured anew with that friction have it."""
    done = command(
        "calibrate", "pile", "--set", "effects.rolling.mu=0.05", "--vary", f"{MU}=0.05..1.0:2", "--measure", "repose_angle",
        "--target", "20", "--within", "1", "-o", tmp_path,
    )  # fmt: skip
    out, error = done.communicate()
    assert done.returncode == 0, error
    assert len(list((tmp_path / "runs").iterdir())) < 25
    mu = float(out.split("=")[1].split()[0])
    scene = sand.load("pile", ["effects.rolling.mu=0.05", "seed=1000"])
    again = sand.sweep(scene, {MU: [mu]}, 8, measures=["repose_angle"])
    assert abs(float(again.repose_angle.mean()) - 20.0) < 1.0


@pytest.mark.slow
def test_two_workers_lose_little_time(tmp_path: Path) -> None:
    """200 runs of settle with 200 grains, in two structures, take less than 1.15 of what making and advancing them takes, over two."""
    vary = {"solver.kind": "md,rigid", MU: list(np.linspace(0.1, 0.5, 10))}
    made = plan.plan(engine.loader("settle", (), ["scale=0.2"]), vary, 10, plan.Asked())
    seconds = []
    for number in np.linspace(0, len(made.jobs) - 1, 24).astype(int):
        start = time.perf_counter()
        job.simulate(made.jobs[number])
        seconds.append(time.perf_counter() - start)
    alone = float(np.median(seconds[:12]) + np.median(seconds[12:])) / 2 * len(made.jobs)
    start = time.perf_counter()
    with engine.runner(2, None, None) as run:
        engine.execute(made, store.Store(tmp_path), run)
    assert time.perf_counter() - start < 1.15 * alone / 2
    assert not results.failed(made, store.Store(tmp_path))
