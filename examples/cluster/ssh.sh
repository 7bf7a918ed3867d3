#!/bin/sh
# dvc repro on several hosts with passwordless ssh and this folder shared under the same path:
#     examples/cluster/ssh.sh HOST...
# Each host runs one worker process per core. The workers stop when this script ends.
set -eu
[ $# -gt 0 ] || { echo "usage: $0 HOST..." >&2; exit 2; }
here=$(pwd)
head=$(hostname)
port=${PORT:-8786}
profiler=DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False  # would accumulate 0.1 MB per second
export PATH="$here/.venv/bin:$PATH"

trap 'kill $(jobs -p) 2>/dev/null || true' EXIT INT TERM
dask scheduler --host "$head" --port "$port" --no-dashboard &
for host in "$@"; do
    # -tt: the remote worker stops when the local ssh does.
    ssh -tt "$host" "cd '$here' && exec env $profiler .venv/bin/dask worker tcp://$head:$port \
        --nworkers -1 --nthreads 1 --no-dashboard --local-directory /tmp" </dev/null &
done
DASK_SCHEDULER_ADDRESS="tcp://$head:$port" dvc repro
