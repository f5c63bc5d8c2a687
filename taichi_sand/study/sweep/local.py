"""Runs on this machine: processes of one thread that live on, take runs of equal structure in turn, and may die without harm to others."""

import contextlib
import multiprocessing as mp
import signal
import time
from collections import deque
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait
from typing import Any, Self

from taichi_sand.study.sweep.job import failure, simulate
from taichi_sand.study.sweep.plan import Job

GRACE = 5.0
"""A run that is past its time is asked to stop by itself; so many seconds later its process is killed."""
LEAVE = 10.0
"""Time that an idle process has to leave [s]: it then files the kernels that it has compiled."""
TRIES = 2
"""A run whose process dies is tried once more: it may have been killed for what another one took."""


def work(pipe: Connection, timeout: float | None) -> None:
    """What a worker does: job in, files out, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the whole group; the command ends its workers itself
    while True:
        try:
            pipe.send(simulate(pipe.recv(), timeout))
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return


class Worker:
    """A process, and what it is doing."""

    def __init__(self, context: Any, timeout: float | None) -> None:
        self.pipe, far = context.Pipe()
        self.process = context.Process(target=work, args=(far, timeout), daemon=True)
        self.process.start()
        far.close()
        self.structure = ""
        self.job: Job | None = None
        self.late = float("inf")  # when its run is past all grace
        self.lost = ""  # crashed or timeout: it takes no more runs

    def give(self, job: Job, timeout: float | None) -> None:
        """The next run."""
        self.job, self.structure = job, job.structure
        self.late = time.monotonic() + timeout + GRACE if timeout else float("inf")
        with contextlib.suppress(BrokenPipeError):  # it has died waiting: `outcome` finds that
            self.pipe.send(job)

    def outcome(self, timeout: float | None) -> dict[str, bytes] | None:
        """The files of its run; None while it runs."""
        files: dict[str, bytes] | None = None
        try:
            if self.pipe.poll():
                files = self.pipe.recv()
            elif not self.process.is_alive():
                raise EOFError
            elif time.monotonic() > self.late:
                self.lost = "timeout"
                files = {"failed.json": failure(self.lost, f"took longer than {timeout:g} s and was stopped")}
        except (EOFError, ConnectionResetError):
            self.process.join(GRACE)
            code = self.process.exitcode
            how = f"was killed by signal {-code}" if code is not None and code < 0 else f"ended with status {code}"
            self.lost = "crashed"
            files = {"failed.json": failure(self.lost, f"the process that ran it {how}")}
        if files is not None:
            self.job = None
        return files

    def end(self) -> None:
        """Lets it go, so that it keeps the kernels that it has compiled; stops it at once if it is at work."""
        self.pipe.close()
        self.process.join(0.0 if self.job or self.lost else LEAVE)
        self.process.kill()
        self.process.join()


class Crew:
    """Processes that take runs in turn, for as long as it is open.

    Args:
        workers: how many processes; they are started as runs need them.
        timeout: wall time that a run may take [s].
    """

    def __init__(self, workers: int, timeout: float | None = None) -> None:
        self.most, self.timeout = workers, timeout
        self.context = mp.get_context("spawn")
        self.crew: list[Worker] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        for worker in self.crew:
            worker.pipe.close()  # all at once
        for worker in self.crew:
            worker.end()
        self.crew = []

    def run(self, jobs: list[Job]) -> Iterator[tuple[Job, dict[str, bytes]]]:
        """Runs `jobs`; yields each with its files, as they are done."""
        waiting, tries = deque(jobs), dict.fromkeys((job.key for job in jobs), 0)
        while len(self.crew) < min(self.most, len(jobs)):
            self.crew.append(Worker(self.context, self.timeout))
        while waiting or any(worker.job for worker in self.crew):
            for worker in self.crew:
                if worker.job is None and waiting:
                    worker.give(choose(waiting, worker, self.crew), self.timeout)
            self._wait()
            for index, worker in enumerate(self.crew):
                job, files = worker.job, worker.outcome(self.timeout) if worker.job else None
                if job is None or files is None:
                    continue
                if worker.lost:
                    worker.end()
                    self.crew[index] = Worker(self.context, self.timeout)
                tries[job.key] += 1
                if worker.lost == "crashed" and tries[job.key] < TRIES:
                    waiting.append(job)
                else:
                    yield job, files

    def _wait(self) -> None:
        """Until a run is done, a process has died, or a run is past its time."""
        busy = [worker for worker in self.crew if worker.job]
        nearest = min(worker.late for worker in busy) - time.monotonic()
        wait([w.pipe for w in busy] + [w.process.sentinel for w in busy], None if nearest == float("inf") else max(0.0, nearest))


def choose(waiting: "deque[Job]", worker: Worker, crew: list[Worker]) -> Job:
    """The next run for a worker: of its own structure, else of one that nobody works on, else any. It is taken out of `waiting`."""
    taken = {other.structure for other in crew if other is not worker}
    own = next((job for job in waiting if job.structure == worker.structure), None)
    free = next((job for job in waiting if job.structure not in taken), None)
    job = own or free or waiting[0]
    waiting.remove(job)
    return job
