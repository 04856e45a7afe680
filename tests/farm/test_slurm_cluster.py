"""The Slurm that other tests stand on: it runs arrays, and it comes back after its node died."""

import time


def wait_until_empty(slurm, seconds=40):
    end = time.monotonic() + seconds
    while slurm.call("squeue", "-h"):
        assert time.monotonic() < end, slurm.call("squeue")
        time.sleep(0.2)


def test_an_array_runs_on_the_loopback_node(slurm, tmp_path):
    command = f"touch {tmp_path}/$SLURM_ARRAY_TASK_ID"
    assert slurm.call("sbatch", "--array=0-3", f"--output={tmp_path}/log", "--wrap", command)
    wait_until_empty(slurm)
    assert {p.name for p in tmp_path.iterdir()} >= {"0", "1", "2", "3"}


def test_the_node_comes_back_after_its_daemon_was_killed(slurm, tmp_path):
    slurm.kill_node()
    slurm.start_node()
    slurm.call("sbatch", f"--output={tmp_path}/log", "--wrap", f"touch {tmp_path}/after")
    wait_until_empty(slurm)
    assert (tmp_path / "after").exists()
