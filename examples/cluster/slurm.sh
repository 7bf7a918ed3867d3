#!/bin/bash
# dvc repro in one SLURM allocation:   sbatch examples/cluster/slurm.sh
# Submit it from the project folder, which must be on a file system shared by all nodes. The dask
# scheduler and dvc run on the first node, and every node runs one worker process per core. After a
# timeout, submit it again: finished frames are kept.
#SBATCH --job-name=pbrnet
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=32
#SBATCH --mem-per-cpu=2G
#SBATCH --time=24:00:00
set -euo pipefail
cd "$SLURM_SUBMIT_DIR"
export PATH="$PWD/.venv/bin:$PATH"
export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False  # would accumulate 0.1 MB per second
port=${PORT:-8786}
address="tcp://$(hostname):$port"

trap 'kill $(jobs -p) 2>/dev/null || true' EXIT
dask scheduler --port "$port" --no-dashboard &
srun --overlap dask worker "$address" --nworkers "$SLURM_CPUS_PER_TASK" --nthreads 1 \
    --no-dashboard --local-directory "${TMPDIR:-/tmp}" &
DASK_SCHEDULER_ADDRESS="$address" dvc repro
