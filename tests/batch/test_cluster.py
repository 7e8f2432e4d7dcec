"""A batch on a Dask cluster of this machine, one worker of which is killed."""

import os
import signal

import numpy as np
import pytest

from lsvision.batch.job import BatchJob
from lsvision.batch.run import plan_tasks, run_batch
from lsvision.errors import LsvisionError
from tests.batch.sources import profiles, write_parquet

distributed = pytest.importorskip("distributed")


@pytest.fixture
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    ) as local:
        yield local


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_killed_worker_costs_nothing_and_the_bytes_are_those_of_this_machine(tmp_path, cluster):
    source = tmp_path / "in"
    source.mkdir()
    for number in range(6):
        write_parquet(source / f"part-{number}.parquet", 4, first_id=number)
    np.savetxt(source / "a.csv", profiles(1)[0], delimiter=",")
    sources = sorted(source.iterdir())
    killed = []

    def report(_):
        if not killed:
            worker = next(iter(cluster.workers.values()))
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    here, there = tmp_path / "here", tmp_path / "there"
    run_batch(plan_tasks(sources, source, here, BatchJob()), here)
    tasks = plan_tasks(sources, source, there, BatchJob())
    status = run_batch(tasks, there, scheduler=cluster.scheduler_address, report=report)
    assert killed
    assert len(status.done) == len(sources)
    for path in here.rglob("*.parquet"):
        assert (there / path.relative_to(here)).read_bytes() == path.read_bytes()


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_no_scheduler_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr("lsvision.batch.cluster.CONNECT_TIMEOUT_S", 0.5)
    write_parquet(tmp_path / "a.parquet", 2)
    tasks = plan_tasks([tmp_path / "a.parquet"], tmp_path, tmp_path / "out", BatchJob())
    with pytest.raises(LsvisionError, match="no scheduler answers"):
        run_batch(tasks, tmp_path / "out", scheduler="tcp://127.0.0.1:9")
