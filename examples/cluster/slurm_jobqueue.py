"""dvc repro with dask workers that dask-jobqueue submits as SLURM jobs.

Install dask-jobqueue and run in the project folder, on a node that can submit jobs:
    .venv/bin/python examples/cluster/slurm_jobqueue.py --jobs 8
Jobs that end are replaced, so a short time limit is enough.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

from dask_jobqueue import SLURMCluster

parser = argparse.ArgumentParser()
parser.add_argument("--jobs", type=int, default=4)
parser.add_argument("--cores", type=int, default=32, help="cores per job")
parser.add_argument("--walltime", default="04:00:00")
parser.add_argument("--partition", default=None)
options = parser.parse_args()

with SLURMCluster(
    cores=options.cores,
    processes=options.cores,  # one single-threaded worker process per core
    memory=f"{2 * options.cores}GB",
    walltime=options.walltime,
    queue=options.partition,
    python=sys.executable,
    local_directory=os.environ.get("TMPDIR", "/tmp"),
    # Dask's profiler would accumulate 0.1 MB per second.
    job_script_prologue=["export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False"],
) as cluster:
    cluster.adapt(minimum_jobs=options.jobs, maximum_jobs=options.jobs)
    programs = Path(sys.executable).parent  # dvc, and pbrnet for the stages
    environment = {
        **os.environ,
        "DASK_SCHEDULER_ADDRESS": cluster.scheduler_address,
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
    }
    done = subprocess.run([programs / "dvc", "repro"], env=environment, check=False)
    sys.exit(done.returncode)
