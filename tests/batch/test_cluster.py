"""A batch on a Dask cluster of this machine, one worker of which is killed."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from lsvision.batch.cluster import run_on_cluster
from lsvision.batch.measure_file import BatchJob
from lsvision.batch.run import plan_tasks, run_batch
from lsvision.errors import LsvisionError
from tests.batch.sources import profiles, write_parquet

PATH_TO_TASKS = {"PYTHONPATH": str(Path(__file__).parents[2])}


@pytest.fixture(scope="module")
def distributed():
    """The library, imported only by the process that runs these tests."""
    return pytest.importorskip("distributed")


@pytest.fixture
def cluster(distributed):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=":0"
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

    def report(*_):
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
def test_an_error_of_a_task_is_not_taken_for_a_lost_connection(distributed):
    in_threads = distributed.LocalCluster(
        n_workers=1,
        processes=False,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
    )
    with in_threads as local, pytest.raises(FileNotFoundError):
        list(run_on_cluster(os.stat, ["/nowhere/a"], local.scheduler_address))


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_no_scheduler_is_reported(distributed, tmp_path, monkeypatch):
    monkeypatch.setattr("lsvision.batch.cluster.CONNECT_TIMEOUT_S", 0.5)
    write_parquet(tmp_path / "a.parquet", 2)
    tasks = plan_tasks([tmp_path / "a.parquet"], tmp_path, tmp_path / "out", BatchJob())
    with pytest.raises(LsvisionError, match="no scheduler answers"):
        run_batch(tasks, tmp_path / "out", scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize("address", ["localhost", "tcp://localhost:", "http://localhost:8786"])
def test_a_malformed_address_is_reported_before_a_client_is_made(
    distributed, tmp_path, monkeypatch, address
):
    monkeypatch.setattr(distributed, "Client", None)
    write_parquet(tmp_path / "a.parquet", 2)
    tasks = plan_tasks([tmp_path / "a.parquet"], tmp_path, tmp_path / "out", BatchJob())
    with pytest.raises(LsvisionError, match="expected the address of a scheduler such as tcp://"):
        run_batch(tasks, tmp_path / "out", scheduler=address)


def address_in(file):
    """The address in a scheduler's file; None before it is written completely."""
    try:
        return json.loads(file.read_text())["address"]
    except (FileNotFoundError, json.JSONDecodeError):
        return None


@pytest.fixture
def scheduler(distributed, tmp_path):
    """A scheduler with one worker, in processes that can be killed; and its address."""
    file, processes = tmp_path / "scheduler.json", []
    for role, words in {
        "scheduler": ("--host", "127.0.0.1", "--port", "0"),
        "worker": ("--nthreads", "1", "--local-directory", str(tmp_path)),
    }.items():
        command = [sys.executable, "-m", f"distributed.cli.dask_{role}", "--no-dashboard", *words]
        command += ["--scheduler-file", str(file)]
        processes.append(
            subprocess.Popen(command, env=os.environ | PATH_TO_TASKS, stderr=subprocess.DEVNULL)
        )
        while not (address := address_in(file)):
            assert processes[0].poll() is None, "the scheduler has ended"
            time.sleep(0.1)
    yield processes[0], address
    for process in processes:
        process.kill()
        process.wait(10)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_that_goes_away_is_reported_and_costs_no_finished_file(
    tmp_path, scheduler, monkeypatch, end
):
    process, address = scheduler
    source, out = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    for number in range(8):
        write_parquet(source / f"{number}.parquet", 2, first_id=number)
    tasks, finished = plan_tasks(sorted(source.iterdir()), source, out, BatchJob()), []

    def report(outcome, _):
        finished.append(outcome.name)
        if len(finished) == 2:
            process.send_signal(end)
            # Only now: on a busy machine a scheduler may take longer to answer.
            monkeypatch.setattr("lsvision.batch.cluster.ANSWER_TIMEOUT_S", 2.0)

    with pytest.raises(LsvisionError, match=r"connection .* is lost .* finished files are kept"):
        run_batch(tasks, out, scheduler=address, report=report)
    kept = {path.name: path.stat().st_mtime_ns for path in out.glob("[01].parquet")}
    assert len(kept) == 2
    assert len(run_batch(tasks, out).done) == 8
    assert kept == {path.name: path.stat().st_mtime_ns for path in out.glob("[01].parquet")}
