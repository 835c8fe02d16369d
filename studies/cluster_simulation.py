"""A discrete-event simulation of the scheduler: what many workers give, and what bounds them.

The model. A task waits for the scheduler, which takes `scheduler_s` for each, one after the other. A worker that does
not hold the scene of the task fetches `fetched` bytes from the store and prepares for `prepare_s`. It works for a time
from a log-normal distribution of mean `work_s` and coefficient of variation `spread`, and sends `returned` bytes to the
client, which takes them one after the other. The store gives `store_bytes_s` to all workers together, first come, first
served, and `worker_bytes_s` to one at most. A worker dies after an exponential time of mean `mean_life_s`: what it
worked on is done again, by a worker that starts anew, `restart_s` later, and must fetch and prepare.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Machines:
    """Workers, and what they share; times in seconds, sizes in bytes."""

    workers: int
    scheduler_s: float = 1e-3
    store_bytes_s: float = 1.25e9
    worker_bytes_s: float = 1.25e8
    client_bytes_s: float = 1.25e9
    mean_life_s: float = 86400.0
    restart_s: float = 30.0


@dataclass(frozen=True)
class SimulatedWork:
    """Tasks: `scenes` in a row, of each `tasks` that need it; a scene after the other where `one_by_one`."""

    scenes: int
    tasks: int
    fetched: float
    prepare_s: float
    work_s: float
    returned: float
    spread: float = 0.2
    one_by_one: bool = False

    def alone_s(self, machines: Machines) -> float:
        """Time of one worker that never dies and waits for nobody."""
        return self.scenes * (self.fetched / machines.worker_bytes_s + self.prepare_s + self.tasks * self.work_s)


@dataclass(frozen=True)
class Result:
    """Time until the last result is there; shares of it that scheduler, store and client were busy.

    prepared: how often a worker made a scene ready. working: share of the workers' time that went into results.
    """

    seconds: float
    scheduler: float
    store: float
    client: float
    deaths: int
    prepared: int
    working: float

    def bound_by(self, workers: int, tasks: int) -> str:
        """What keeps the result from coming sooner, in words."""
        busiest = max((self.scheduler, "scheduler"), (self.store, "store"), (self.client, "client's link"))
        if busiest[0] > 0.8:
            return busiest[1]
        if tasks < 4 * workers:
            return "number of tasks"
        return "workers" if self.working > 0.8 else "preparation of scenes"


class Line:
    """Who serves one after the other, in the order in which they ask."""

    def __init__(self) -> None:
        self.free, self.busy = 0.0, 0.0

    def served(self, now: float, seconds: float) -> float:
        """Time at which a service of `seconds` that is asked for `now` ends."""
        self.free = max(self.free, now) + seconds
        self.busy += seconds
        return self.free


def simulate(work: SimulatedWork, machines: Machines, seed: int = 0) -> Result:
    """Run all tasks of `work` on `machines`."""
    total = SimulatedRun(work, machines, seed)
    if not work.one_by_one:
        return total.run(work.scenes * work.tasks)
    for _ in range(work.scenes):
        total.run(work.tasks)
    return total.result()


class SimulatedRun:
    """The state of a simulation."""

    def __init__(self, work: SimulatedWork, machines: Machines, seed: int) -> None:
        self.work, self.machines, self.chance = work, machines, np.random.default_rng(seed)
        self.scheduler, self.store, self.client = Line(), Line(), Line()
        self.now = self.worked = 0.0
        self.deaths = self.prepared = self.first = 0
        self.held = [-1] * machines.workers  # the scene that each worker has made ready
        self.sigma = float(np.sqrt(np.log1p(work.spread**2)))

    def run(self, count: int) -> Result:
        """`count` more tasks, all ready now; the time goes on to the last result."""
        waiting = list(range(self.first + count - 1, self.first - 1, -1))
        self.first += count
        free = [(self.now, worker) for worker in range(self.machines.workers)]
        heapq.heapify(free)
        last = self.now
        while waiting:
            asked, worker = heapq.heappop(free)
            task = waiting.pop()
            end, lived = self._worked(self.scheduler.served(asked, self.machines.scheduler_s), worker, task)
            if lived:
                last = max(last, self.client.served(end, self.work.returned / self.machines.client_bytes_s))
            else:
                waiting.append(task)
            heapq.heappush(free, (end, worker))
        self.now = last
        return self.result()

    def _worked(self, begin: float, worker: int, task: int) -> tuple[float, bool]:
        """When a worker is free again, and whether the task is done."""
        work, machines, scene = self.work, self.machines, task // self.work.tasks
        ready = begin
        if self.held[worker] != scene:
            fetched = self.store.served(begin, work.fetched / machines.store_bytes_s)
            ready = max(fetched, begin + work.fetched / machines.worker_bytes_s) + work.prepare_s
            self.prepared += 1
        seconds = work.work_s * float(np.exp(self.sigma * self.chance.standard_normal() - 0.5 * self.sigma**2))
        life = float(self.chance.exponential(machines.mean_life_s))
        if begin + life < ready + seconds:
            self.deaths, self.held[worker] = self.deaths + 1, -1
            return begin + life + machines.restart_s, False
        self.held[worker] = scene
        self.worked += seconds
        return ready + seconds, True

    def result(self) -> Result:
        """What has come of it so far."""
        scheduler, store, client = (line.busy / self.now for line in (self.scheduler, self.store, self.client))
        working = self.worked / (self.now * self.machines.workers)
        return Result(self.now, scheduler, store, client, self.deaths, self.prepared, working)
