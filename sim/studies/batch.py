"""Many lockstep flights at once: one process a core, results in the order of the jobs, progress shown."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

Job = TypeVar("Job")
Result = TypeVar("Result")

Told = Callable[[], None]


def run_all(work: Callable[[Job], Result], jobs: Sequence[Job], done: Told, workers: int | None = None) -> list[Result]:
    """`work(job)` for every job; `work` and jobs must be picklable. Raises what a job raises; `done` after each job."""
    count = min(workers or cores(), len(jobs))
    if count <= 1:
        return [_told(work(job), done) for job in jobs]
    # Spawned, not forked: a fork would take along threads of numba and zstd in whatever state they are.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, mp_context=context) as pool:
        futures: list[Future[Result]] = [pool.submit(work, job) for job in jobs]
        try:
            for future in as_completed(futures):
                future.result()
                done()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]


def cores() -> int:
    """How many processes this one may keep busy."""
    return len(os.sched_getaffinity(0))


@contextmanager
def progress_bar(console: Console, title: str, total: int) -> Iterator[Told]:
    """A bar that moves on by one each time it is told."""
    columns = (
        TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"),
        TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=total)
        yield lambda: bar.advance(task)


def _told(result: Result, done: Told) -> Result:
    done()
    return result
