#!/bin/sh
# Train on two ranks in two network namespaces, joined by a link of limited bandwidth: what a slow network costs.
# usage: sudo sh docs/measurements/slow_network.sh RATE [VIEWS]     a rate such as 1gbit or 100mbit; views as for ranks.py
set -eu
rate=$1 views=${2:-} python=${PYTHON:-.venv/bin/python}
cleanup() { for k in 0 1; do ip netns del svv$k 2> /dev/null || true; done; }
trap cleanup EXIT
cleanup
ip netns add svv0 && ip netns add svv1
ip link add v0 netns svv0 type veth peer name v1 netns svv1
for k in 0 1; do
    ip -n svv$k addr add 10.77.0.$((k + 1))/24 dev v$k
    ip -n svv$k link set lo up && ip -n svv$k link set v$k up
    tc -n svv$k qdisc add dev v$k root tbf rate "$rate" burst 64kb latency 100ms
done
for k in 1 0; do
    env PYTHONPATH=. OMP_NUM_THREADS=1 RANK=$k WORLD_SIZE=2 LOCAL_RANK=0 LOCAL_WORLD_SIZE=1 MASTER_ADDR=10.77.0.1 \
        MASTER_PORT=29511 GLOO_SOCKET_IFNAME=v$k ip netns exec svv$k "$python" docs/measurements/ranks.py ${views:+"$views"} &
done
wait
