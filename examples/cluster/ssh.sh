#!/bin/sh
# dvc repro on several machines that share this folder under the same path and that ssh reaches
# without a password:
#     examples/cluster/ssh.sh HOST...
# Each host gets one worker process for each of its cores. All of it ends with this script.
set -eu
[ $# -gt 0 ] || { echo "usage: $0 HOST..." >&2; exit 2; }
here=$(pwd)
head=$(hostname)
port=${PORT:-8786}
profiler=DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False  # it would keep 0.1 MB a second
export PATH="$here/.venv/bin:$PATH"

trap 'kill $(jobs -p) 2>/dev/null || true' EXIT INT TERM
dask scheduler --host "$head" --port "$port" --no-dashboard &
for host in "$@"; do
    # -tt: the far end is told to stop when this end does.
    ssh -tt "$host" "cd '$here' && exec env $profiler .venv/bin/dask worker tcp://$head:$port \
        --nworkers -1 --nthreads 1 --no-dashboard --local-directory /tmp" </dev/null &
done
DASK_SCHEDULER_ADDRESS="tcp://$head:$port" dvc repro
