"""The Dask cluster that a batch runs on: worker processes of this machine, or a scheduler that is there."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from typing import TYPE_CHECKING

from vision.contract.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

#: Seconds that a scheduler and its workers are waited for.
PATIENCE = 30


@contextmanager
def cluster(workers: int | None, scheduler: str | None) -> "Iterator[Client]":
    """Connect to a scheduler, or start worker processes here for as long as the context lasts."""
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise InputError("batch needs Dask distributed; pip install 'roadfiber[cluster]'") from error
    if workers is not None and (workers < 1 or scheduler is not None):
        raise InputError(f"workers {workers}; give 1 or more, or a scheduler in their place")
    # What becomes of every task is told by the batch itself.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if scheduler is None:
        # No dashboard: its port may be another program's.
        nowhere = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
        processes = {"n_workers": workers, "threads_per_worker": 1, "processes": True}
        with LocalCluster(**processes, scheduler_kwargs=nowhere) as local, Client(local) as client:
            yield client
        return
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(f"{scheduler}: no scheduler answers; give an address as tcp://10.0.0.1:8786") from error
    with client:
        require_alike(client, scheduler)
        yield client


def require_alike(client: "Client", scheduler: str) -> None:
    """Refuse a scheduler without workers, or whose workers have another roadfiber than this."""
    with suppress(TimeoutError):
        client.wait_for_workers(1, timeout=PATIENCE)
    mine = version("roadfiber")
    try:
        theirs = client.run(version, "roadfiber")
    except ImportError as error:
        raise InputError(f"{scheduler}: a worker has no roadfiber; install version {mine} there") from error
    if not theirs:
        raise InputError(f"{scheduler}: has no workers; start some with `dask worker {scheduler} --nthreads 1`")
    for worker, one in theirs.items():
        if one != mine:
            raise InputError(
                f"{scheduler}: worker {worker} has roadfiber {one}, here it is {mine}; install one version"
            )
