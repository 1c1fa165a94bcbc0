"""The one runner of all studies: jobs on every core, progress, results in the order of the jobs, files."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from wire.files import make_folder, new_files
from wire.process.system import safe_path_for_pools

Job = TypeVar("Job")
Result = TypeVar("Result")

Done = Callable[[], None]


class Runner:
    """Runs the jobs of a study, shows how far they are, and writes down what came of them.

    workers: processes at most; without it one a core.
    """

    def __init__(self, console: Console, workers: int | None = None) -> None:
        self._console = console
        self._workers = workers

    def run(self, title: str, work: Callable[[Job], Result], jobs: Sequence[Job]) -> list[Result]:
        """`work(job)` for every job, as `run_all`, under a bar with a title."""
        with _progress_bar(self._console, title, len(jobs)) as done:
            return run_all(work, jobs, done, self._workers)

    def write(self, folder: Path, texts: Mapping[str, str], overwrite: bool = False) -> None:
        """Write the files into the folder, which is made if need be, as `new_files` names them, and say which."""
        make_folder(folder)
        with new_files(*(folder / name for name in texts), overwrite=overwrite) as paths:
            for path, text in zip(paths, texts.values(), strict=True):
                path.write_text(text, encoding="utf-8")
        self._console.print("  ".join(map(str, paths)), highlight=False)


def run_all(work: Callable[[Job], Result], jobs: Sequence[Job], done: Done, workers: int | None = None) -> list[Result]:
    """`work(job)` for every job; `work` and jobs must be picklable. Raises what a job raises; `done` after each job."""
    count = min(workers or cores(), len(jobs))
    if count <= 1:
        results = []
        for job in jobs:
            results.append(work(job))
            done()
        return results
    # Spawned, not forked: a fork would take along threads of numba and zstd in whatever state they are.
    context = multiprocessing.get_context("spawn")
    with safe_path_for_pools(), ProcessPoolExecutor(count, mp_context=context) as pool:
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
def _progress_bar(console: Console, title: str, total: int) -> Iterator[Done]:
    """A bar that moves on by one with each call, and is gone at the end; no thread, beside which no flight can fork."""
    columns = (
        TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"),
        TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task(title, total=total)
        yield lambda: bar.update(task, advance=1, refresh=True)
