"""A program whose processes open the same new store at the same moment."""

from __future__ import annotations

# MLflow is imported before the fork, so that the processes open the new store at the same time.
OPEN_TOGETHER = """
import multiprocessing, sys
import mlflow
from dashred.core.mlflow.tracker import Tracker

def work(barrier, root, artifacts, name):
    barrier.wait()
    with Tracker.open(root, "rde", name, artifacts=artifacts) as tracker:
        for step in range(10):
            tracker.log_metrics({"loss/train": 1.0 / (1 + step)}, step)
        with tracker.child("shred") as child:
            child.log_metrics({"rmse": 0.1}, 0)

root, artifacts = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None
fork = multiprocessing.get_context("fork")
barrier = fork.Barrier(4)
names = [f"run {index}" for index in range(4)]
started = [fork.Process(target=work, args=(barrier, root, artifacts, name)) for name in names]
for process in started:
    process.start()
for process in started:
    process.join()
sys.exit(max(process.exitcode for process in started))
"""
