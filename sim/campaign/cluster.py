"""The same work on a Dask cluster (the extra `cluster`), each job a process's as on this machine."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from rich.console import Console

Job = TypeVar("Job")
Result = TypeVar("Result")


class Cluster:
    """The workers of one scheduler, which need this project installed."""

    def __init__(self, address: str, console: Console) -> None:
        """OSError if there is no scheduler; ImportError without the extra."""
        from distributed import Client

        self._client = Client(address)
        self._console = console

    def run(self, title: str, work: Callable[[Job], Result], jobs: Sequence[Job]) -> list[Result]:
        """`work(job)` for every job, in the order of the jobs. Raises what a job raises."""
        from distributed import as_completed

        futures = self._client.map(work, jobs, pure=False)
        with self._console.status(title) as status:
            for done, _ in enumerate(as_completed(futures), 1):
                status.update(f"{title}: {done} of {len(jobs)}")
        return list(self._client.gather(futures))
