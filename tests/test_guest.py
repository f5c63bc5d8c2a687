"""A good guest in somebody else's process: their Taichi, their threads and forks, no home, memory given back. Each script is a process."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
START = """
import gc, os, sys, threading, time
import numpy as np
import taichi_sand as sand

def scene(**keys):
    return sand.Scene(**{"size": [0.2, 0.3], "grains": [{"radius": 0.01, "count": 20}], **keys})

def refused(call, *words):
    try:
        call()
    except sand.SandError as error:
        assert all(word in str(error) for word in words), error
    else:
        raise AssertionError("not refused")
"""


def run(script: str, *, timeout: float = 300, **env: str | None) -> subprocess.CompletedProcess:
    """Runs a script after START; `env` changes the environment, None takes out."""
    variables = {name: value for name, value in {**os.environ, "PYTHONPATH": str(ROOT), **env}.items() if value is not None}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "script.py"  # kernels need their source
        path.write_text(START + script, "utf-8")
        command = [sys.executable, "-X", "faulthandler", str(path)]
        done = subprocess.run(command, env=variables, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
    assert done.returncode == 0, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def test_somebody_elses_taichi() -> None:
    """A simulation lives in it and leaves what is there alone; what does not fit, or is gone, is told in a sentence."""
    run("""
import taichi as ti
ti.init(arch=ti.cpu, log_level=ti.ERROR)
theirs = ti.field(ti.i32, 5)
array = ti.ndarray(ti.f32, 3)

@ti.kernel
def add():
    for i in theirs:
        theirs[i] += i

add()
made = type(theirs).to_numpy
sim = sand.Simulation(scene())
sim.advance(0.05)
add()
assert theirs.to_numpy().tolist() == [0, 2, 4, 6, 8] and type(theirs).to_numpy is made
assert sim.threads == os.cpu_count() or sim.threads == len(os.sched_getaffinity(0))
refused(lambda: sand.Simulation(scene(solver={"precision": 64})), "default_fp", "f64", "close that first")
refused(lambda: sand.Simulation(scene(), arch="gpu"), "arch = x64", "--arch gpu")
before, time_before = sim.positions, sim.time
del sim
refused(lambda: sand.Simulation(scene(solver={"precision": 64})), "default_fp", "this program has started it", "ti.reset()")
refused(lambda: sand.Simulation(scene(), threads=17), "cpu_max_num_threads", "--threads 17")
from taichi_sand.taichi_support import runtime
runtime.forget()  # full, or unused: even so it is theirs
sim = sand.Simulation(scene())
sim.advance(0.05)
assert (sim.positions == before).all() and sim.time == time_before
add()
assert theirs.to_numpy().tolist() == [0, 3, 6, 9, 12]

ti.init(arch=ti.cpu, log_level=ti.ERROR)  # all is gone
for ask in (lambda: sim.positions, lambda: sim.advance(0.1), sim.report, sim.image, sim.flags, lambda: sim.save("x.npz"), lambda: sim.count,
            lambda: sim.set("gravity", [0, 0]), lambda: sim.wet(0, 0, 1, 1), lambda: sim.set_walls([])):
    refused(ask, "started afresh")
sim.close()
for name, wrong in {"fast_math": False, "debug": True, "default_ip": ti.i64, "short_circuit_operators": False}.items():
    ti.init(arch=ti.cpu, log_level=ti.ERROR, **{name: wrong})
    refused(lambda: sand.Simulation(scene()), name, "is needed")

ti.init(arch=ti.cpu, log_level=ti.ERROR)
thread = threading.Thread(target=lambda: refused(lambda: sand.Simulation(scene()), "in another thread"))
thread.start()
thread.join()
""")


@pytest.mark.slow
def test_their_taichi_and_ours_in_turns() -> None:
    """After theirs another of theirs, then ours: started afresh only where nobody loses anything, and to the same bits."""
    run("""
import taichi as ti
ti.init(arch=ti.cpu, log_level=ti.ERROR)
sim = sand.Simulation(scene())
sim.advance(0.05)
before = sim.positions
ti.init(arch=ti.cpu, log_level=ti.ERROR)  # all is gone
again = sand.Simulation(scene())
again.advance(0.05)
assert (again.positions == before).all()
del again, sim
ti.reset()  # nobody's: we start it
ours = sand.Simulation(scene(), threads=1)
ours.advance(0.05)
assert (ours.positions == before).all()
theirs = ti.field(ti.f32, 4)
theirs[3] = 3  # as a kernel that has seen it would hold it for ever
del ours
refused(lambda: sand.Simulation(scene(), threads=2), "somebody has fields in it")
assert theirs[3] == 3
array = ti.ndarray(ti.f32, 3)
del theirs
refused(lambda: sand.Simulation(scene(), threads=2), "somebody has fields in it")
del array
two = sand.Simulation(scene(), threads=2)
two.advance(0.05)
assert two.threads == 2 and (two.positions == before).all()
ti.reset()
refused(lambda: two.positions, "started afresh, or reset")
del two
assert sand.Simulation(scene()).count == 20
""")


@pytest.mark.parametrize("home", [None, "/proc/nowhere", pytest.param("", marks=pytest.mark.slow)])
def test_no_home(home: str | None, tmp_path: Path) -> None:
    """Unset it is that of the user; where it cannot be written to compiled kernels go elsewhere, which is said once."""
    script = """
sim = sand.Simulation(scene(), threads=1)
sim.advance(0.05)
del sim
gc.collect()
from taichi_sand.taichi_support import runtime
runtime.start(type("User", (), {})(), "cpu", 2, 32)  # once more
print("done")
"""
    done = run(script, HOME=home, TMPDIR=str(tmp_path), TI_OFFLINE_CACHE_FILE_PATH=None)
    assert done.stdout == "done\n"
    if home == "/proc/nowhere":
        assert done.stderr.count("cannot be written to; compiled kernels are kept in") == 1 and len(done.stderr.splitlines()) == 1
        (place,) = tmp_path.iterdir()
        assert place.stat().st_mode & 0o077 == 0 and list(place.iterdir())


def test_forks() -> None:
    """A child gets a sentence, not a hang, and can end; its parent goes on. One forked before Taichi has run can simulate."""
    done = run("""
import multiprocessing

def child(task, status=0):
    pid = os.fork()
    if pid == 0:
        import faulthandler
        faulthandler.dump_traceback_later(60, exit=True)
        task()
        sys.stdout.flush()
        sys.exit(status)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == status

sand.Simulation  # imported
child(lambda: print("first", sand.Simulation(scene(), threads=2).count))
sim = sand.Simulation(scene(), threads=2)
sim.advance(0.02)

def asks():
    for ask in (lambda: sim.positions, lambda: sim.advance(0.1), lambda: sand.Simulation(scene()), sim.report, sim.image):
        refused(ask, "spawn", "forked")

def drops():
    global sim
    del sim
    gc.collect()

child(asks, 3)
child(drops)
with multiprocessing.get_context("fork").Pool(1) as pool:
    for found in pool.imap_unordered(abs, [-1]):
        assert found == 1
turn = __import__("taichi_sand.taichi_support.turns").taichi_support.turns.turn
entered, leave = threading.Event(), threading.Event()

def hold():
    with turn:
        entered.set()
        leave.wait()

thread = threading.Thread(target=hold)
thread.start()
entered.wait()
child(asks)  # while another thread had its turn
leave.set()
thread.join()
sim.advance(0.02)
print("parent", sim.time > 0.03)
""")
    assert done.stdout.splitlines() == ["first 20", "parent True"]


def test_threads() -> None:
    """Simulations made and advanced in several threads; one that is read, and meddled with, while another thread advances it."""
    done = run("""
from concurrent.futures import ThreadPoolExecutor
stdout = sys.stdout
kinds = ["md", "rigid", "md", "rigid"]

def work(kind):
    sim = sand.Simulation(scene(solver={"kind": kind}), threads=1)
    sim.advance(0.1)
    assert sys.stdout is stdout
    return sim.positions

with ThreadPoolExecutor(4) as pool:
    found = list(pool.map(work, kinds))
assert sys.stdout is stdout
for kind, positions in zip(kinds, found):
    assert (work(kind) == positions).all()

sim = sand.Simulation(scene(), threads=1)
end = threading.Event()

def go():
    def stop(share):
        if end.is_set():
            raise InterruptedError
    try:
        sim.advance(1e5, progress=stop)
    except InterruptedError:
        print("stopped")

thread = threading.Thread(target=go)
thread.start()
while sim.runner is None:
    time.sleep(0.01)
for _ in range(20):
    report = sim.report()
    assert abs(report["time_s"] - report["steps"] * report["step_s"]) < 0.1 * report["time_s"] + 1e-9 and np.isfinite(sim.positions).all()
    for change in (lambda: sim.advance(0.1), lambda: sim.set("gravity", [0, 0]), sim.close, sim.renew):
        refused(change, "another thread")
end.set()
thread.join()
sim.set("gravity", [0, 0])
sim.advance(0.1)
""")
    assert done.stdout == "stopped\n"


def test_no_gpu() -> None:
    """--arch gpu tries what there is, never OpenGL, and says so if there is nothing."""
    done = run(
        """
import taichi as ti
from taichi.lang import misc
asked = []
real = misc.is_arch_supported
misc.is_arch_supported = lambda arch: (asked.append(arch), arch == ti.cpu and real(arch))[1]
refused(lambda: sand.Simulation(scene(), arch="gpu"), "--arch gpu", "take --arch cpu")
assert asked == [ti.cuda, ti.metal, ti.vulkan], asked
assert sand.Simulation(scene()).count == 20
print("done")
"""
    )
    assert done.stdout == "done\n"


def test_closed() -> None:
    """Memory and kernels of a closed simulation go to the next one, or back to the system; it says that it is closed."""
    run("""
from taichi_sand.taichi_support import runtime

with sand.Simulation(scene(), threads=1) as sim:
    sim.advance(0.05)
    world, before = sim.world, sim.positions
for ask in (lambda: sim.positions, lambda: sim.advance(0.1), lambda: sim.advance_steps(1), sim.report, sim.image, sim.renew,
            lambda: sim.set("gravity", [0, 0]), sim.__enter__):
    refused(ask, "has been closed")
sim.close()
made = runtime.compiled()
other = sand.Simulation(scene(), threads=1)
other.advance(0.05)
assert other.world is world and (other.positions == before).all()
assert runtime.compiled() <= made + 1  # which asks where a table lies that is cleared for the first time
other.close()
""")


@pytest.mark.slow
def test_much_memory_goes_back() -> None:
    """To the system, when what is closed held much."""
    run("""
def rss():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 2**20

def large():
    with sand.Simulation(scene(size=[40.0, 40.0], grains=[{"radius": 0.01, "count": 150_000, "fill": "lattice"}]), threads=1) as big:
        return rss(), big.count

with sand.Simulation(scene(), threads=1) as sim:
    sim.advance(0.05)
small = rss()
for _ in range(2):
    most, count = large()
    gc.collect()
    assert count == 150_000 and most - small > 150 and rss() - small < 0.3 * (most - small), (small, most, rss())
""")


PLAIN_TESTS = ["test_census.py", "test_checkpoint.py", "test_dial.py", "test_time.py", "physics/test_impact.py"]


def test_taichi_left_as_it_is() -> None:
    """Without our changes to Taichi all is the same, to the bit, and none of its functions has been replaced."""
    script = """
import hashlib
import taichi as ti
from taichi._snode.fields_builder import FieldsBuilder
from taichi.lang import kernel_impl
from taichi.lang.field import Field, ScalarField
from taichi.lang.matrix import MatrixField
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
own = (kernel_impl.getsourcelines, ASTTransformerContext.get_pos_info, kernel_impl.Kernel.__call__, FieldsBuilder._finalize)
classes = [vars(kind).copy() for kind in (Field, ScalarField, MatrixField)]
total = hashlib.sha256()
for kind in ["rigid"]:
    sim = sand.Simulation(scene(solver={"kind": kind}, effects={"friction": {}}), threads=1)
    sim.advance(0.1)
    sim.set("effects.friction.mu", 0.2)
    path = os.environ["PLACE"] + "/" + kind + ".npz"
    sim.save(path)
    del sim
    sim = sand.Simulation.resume(path, threads=1)
    sim.advance(0.1)
    total.update(sim.positions.tobytes() + sim.image().tobytes())
    del sim
same = own == (kernel_impl.getsourcelines, ASTTransformerContext.get_pos_info, kernel_impl.Kernel.__call__, FieldsBuilder._finalize)
assert classes == [vars(kind) for kind in (Field, ScalarField, MatrixField)]
print(total.hexdigest(), same)
"""
    with tempfile.TemporaryDirectory() as place:
        outputs = [run(script, TAICHI_SAND_PLAIN=plain, PLACE=place).stdout.split() for plain in ("0", "1")]
    assert outputs[0][0] == outputs[1][0] and [same for _, same in outputs] == ["False", "True"]


@pytest.mark.slow
def test_tests_pass_with_taichi_left_as_it_is() -> None:
    """Some that reach into fields in every way."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(str(ROOT / "tests" / name) for name in PLAIN_TESTS)]
    done = subprocess.run(command, env={**os.environ, "TAICHI_SAND_PLAIN": "1"}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.slow
def test_thousands_in_one_process() -> None:
    """2000 simulations of eight structures: memory after 200 and after 2000 within 5 %."""
    done = run(
        """
def rss():
    gc.collect()
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 2**20

effects = [{}, {"friction": {}}, {"friction": {}, "cohesion": {}}, {"drag": {}}]
kinds = [(kind, table) for kind in ("md", "rigid") for table in effects]
for k in range(2000):
    kind, table = kinds[k % 8]
    sim = sand.Simulation(scene(solver={"kind": kind, "tolerance": 0.01 + 1e-5 * k}, effects=table, seed=k), threads=1)
    sim.advance(0.02)
    sim.report()
    if k % 3 == 0:
        sim.close()
    del sim
    if k + 1 in (200, 2000):
        print(k + 1, rss())
""",
        timeout=3600,
    )
    (_, early), (_, late) = (line.split() for line in done.stdout.splitlines())
    assert float(late) < 1.05 * float(early)
