"""Runs on a real Ray cluster, started here on the loopback with two workers: the same records as on this machine."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import psutil
import pytest
from shuffled_suites import results_of, run_shuffled, specs

from sprl_bench.records import RunRecord, find_records
from sprl_bench.records.folder import CHECKPOINT, METRICS, RECORD
from sprl_bench.run import run

pytest.importorskip("ray")
pytestmark = pytest.mark.xdist_group("ray")

COMMAND = [sys.executable, "-m", "sprl_bench"]
RAY = [sys.executable, "-c", "from ray.scripts.scripts import main; main()"]
LONG = 900_000  # env steps of a run that is disturbed; it is never finished


def free_port() -> int:
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        return int(place.getsockname()[1])


class Cluster:
    """A cluster of this test's own: its processes, its files and its token."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        own = {"RAY_ADDRESS": f"127.0.0.1:{self.port}", "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": "c0ffee" * 8}
        self.environment = {**os.environ, **own, "RAY_USAGE_STATS_ENABLED": "0", "RAY_TMPDIR": str(folder)}

    def start(self) -> None:
        address = ["--node-ip-address=127.0.0.1", f"--port={self.port}"]
        self._ray("start", "--head", *address, "--num-cpus=2", "--include-dashboard=false", "--disable-usage-stats")

    def stop(self) -> None:
        """End the processes of this cluster alone."""
        mine = [process for process in psutil.process_iter(["cmdline"]) if self._is_mine(process)]
        for process in mine:
            process.kill()
        psutil.wait_procs(mine, timeout=10)

    def _is_mine(self, process: psutil.Process) -> bool:
        words = " ".join(process.info["cmdline"] or ())
        return str(self.port) in words and "ray" in words and process.pid != os.getpid()

    def _ray(self, *words: str) -> None:
        done = subprocess.run(
            [*RAY, *words], check=False, env=self.environment, capture_output=True, text=True, timeout=120
        )
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    folder = Path("/tmp") / f"ray-{os.getpid()}"  # Ray's sockets need a short path
    folder.mkdir()
    made = Cluster(folder)
    made.start()
    yield made
    made.stop()
    subprocess.run(["rm", "-rf", str(folder)], check=True)


def run_command(folder: Path, environment: Mapping[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, "run", "--suite", "smoke", "--device", "cpu", "--out", "runs", *words]
    return subprocess.run(
        command, check=False, cwd=folder, env=environment, capture_output=True, text=True, timeout=240
    )


def told(records: list[RunRecord]) -> list[tuple[object, ...]]:
    return [(one.spec, one.return_curve, one.success_curve, one.scores, one.totals) for one in records]


def wait_for(what: Callable[[], bool], seconds: float = 90) -> None:
    deadline = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_a_suite_gives_the_records_that_it_gives_here(cluster: Cluster, tmp_path: Path) -> None:
    words = ["--agents", "random,ppo", "--seeds", "2", "--budget", "4000"]
    (tmp_path / "here").mkdir()
    done = run_command(tmp_path, cluster.environment, *words, "--executor", "ray")
    assert done.returncode == 0, done.stderr
    assert run_command(tmp_path / "here", os.environ, *words).returncode == 0
    there, here = find_records(tmp_path / "runs"), find_records(tmp_path / "here" / "runs")
    assert len(there) == 4
    assert told(there) == told(here)
    again = run_command(tmp_path, cluster.environment, *words, "--executor", "ray")
    assert again.returncode == 0
    assert again.stderr.count("skipped") == 4


@pytest.mark.slow
def test_a_shuffled_suite_with_interruptions_gives_them_too(cluster: Cluster, tmp_path: Path) -> None:
    run_shuffled("ray", 2, 5, tmp_path / "there", cluster.environment)
    for spec in specs():
        run(spec, tmp_path / "here")
    assert results_of(tmp_path / "there") == results_of(tmp_path / "here")


def started(folder: Path, environment: Mapping[str, str], *words: str) -> subprocess.Popen[str]:
    command = [*COMMAND, "run", "--suite", "smoke", "--device", "cpu", "--out", "runs", "--executor", "ray", *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=folder, env=environment, text=True, **pipes)  # type: ignore[call-overload]


def test_a_killed_worker_fails_its_run_alone(cluster: Cluster, tmp_path: Path) -> None:
    words = ["--agents", "ppo", "--seeds", "2", "--budget", "30000"]
    command = started(tmp_path, cluster.environment, *words)
    wait_for(lambda: len(list(tmp_path.rglob(METRICS))) == 2 and all(p.stat().st_size for p in tmp_path.rglob(METRICS)))
    workers = [one for one in psutil.process_iter(["cmdline"]) if "ray::ppo" in " ".join(one.info["cmdline"] or ())]
    assert len(workers) == 2
    workers[0].kill()
    _, err = command.communicate(timeout=200)
    assert command.returncode == 1
    assert "1 of 2 runs failed" in err
    assert len(list(tmp_path.rglob(RECORD))) == 1
    again = run_command(tmp_path, cluster.environment, *words, "--executor", "ray")
    assert again.returncode == 0, again.stderr
    assert [one.status for one in find_records(tmp_path / "runs")] == ["complete"] * 2


def test_ctrl_c_leaves_checkpoints(cluster: Cluster, tmp_path: Path) -> None:
    command = started(tmp_path, cluster.environment, "--agents", "ppo", "--seeds", "1", "--budget", str(LONG))
    wait_for(lambda: any(path.stat().st_size for path in tmp_path.rglob(METRICS)))
    command.send_signal(signal.SIGINT)
    _, err = command.communicate(timeout=120)
    assert command.returncode == 130
    assert err.splitlines()[-1] == "sprl-bench: Interrupted; the same command continues from here."
    assert list(tmp_path.rglob(CHECKPOINT))


@pytest.mark.slow
def test_a_head_that_is_lost_ends_the_command_and_a_new_one_continues(tmp_path: Path) -> None:
    folder = Path("/tmp") / f"ray-{os.getpid()}-lost"
    folder.mkdir()
    lost = Cluster(folder)
    lost.environment["RAY_gcs_rpc_server_reconnect_timeout_s"] = "5"
    lost.start()
    words = ["--agents", "ppo", "--seeds", "1", "--budget", "40000"]
    try:
        command = started(tmp_path, lost.environment, *words)
        wait_for(lambda: any(path.stat().st_size for path in tmp_path.rglob(METRICS)))
        lost.stop()
        command.communicate(timeout=120)
        assert command.returncode != 0
        lost.start()
        again = run_command(tmp_path, lost.environment, *words, "--executor", "ray")
        assert again.returncode == 0, again.stderr
        assert [one.status for one in find_records(tmp_path / "runs")] == ["complete"]
    finally:
        lost.stop()
        subprocess.run(["rm", "-rf", str(folder)], check=True)


def test_without_a_cluster_one_sentence_says_how_to_get_one(tmp_path: Path) -> None:
    nowhere = {**os.environ, "RAY_TMPDIR": str(tmp_path), "RAY_USAGE_STATS_ENABLED": "0"}
    nowhere.pop("RAY_ADDRESS", None)
    done = run_command(tmp_path, nowhere, "--agents", "random", "--seeds", "1", "--executor", "ray")
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if line.startswith("sprl-bench: ")]
    assert lines == [
        "sprl-bench: executor is 'ray', but no cluster answers; start one with `ray start --head`, or set RAY_ADDRESS. "
        "A cluster that asks for a token needs the same one here."
    ]
    assert not list(tmp_path.rglob(RECORD))


def test_an_address_where_nothing_listens_is_named_at_once(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"127.0.0.1:{free.getsockname()[1]}"
    nowhere = {**os.environ, "RAY_TMPDIR": str(tmp_path), "RAY_ADDRESS": address}
    begun = time.monotonic()
    done = run_command(tmp_path, nowhere, "--agents", "random", "--seeds", "1", "--executor", "ray")
    assert time.monotonic() - begun < 60  # Ray itself waits for minutes
    assert done.returncode == 1
    assert f"sprl-bench: RAY_ADDRESS is '{address}', but no cluster answers there" in done.stderr
    assert "Traceback" not in done.stderr
