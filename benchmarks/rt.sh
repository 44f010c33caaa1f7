#!/bin/sh
# The loop's timing on this machine, beside cyclictest at the same priority and period, idle and under load.
# Usage: benchmarks/rt.sh [seconds a run]
set -eu
seconds=${1:-20}
for tool in cyclictest stress-ng; do
    command -v $tool > /dev/null || {
        echo "$tool is missing: sudo apt-get install rt-tests stress-ng" >&2
        exit 2
    }
done
program=target/release/tilthex-rt
vehicle=target/release/tilthex-sim
out=$(mktemp -d)
trap 'kill $(jobs -p) 2> /dev/null || true; rm -rf "$out"' EXIT
last=$(($(nproc) - 1))

# p50, p99, p99.9 and largest of cyclictest's histogram (us).
quantiles() {
    awk '$1 ~ /^[0-9]+$/ { value[NR] = $1; count[NR] = $2; total += $2; order[++n] = NR }
         /Max Latencies/ { largest = $4 }
         END { split("0.5 0.99 0.999", q, " ")
               for (j = 1; j <= 3; j++) { sum = 0
                   for (i = 1; i <= n; i++) { sum += count[order[i]]
                       if (sum >= q[j] * total) { printf "%8d", value[order[i]] + 0; break } } }
               printf "%8d us\n", largest + 0 }' "$1"
}

measure() {
    echo "== $1"
    # The vehicle is a program of its own, as the real one is.
    "$vehicle" --link "$out/vehicle" --mocap natnet://127.0.0.1:15110/1 > "$out/sim" 2>&1 &
    simulated=$!
    sleep 1
    # At the same time, half a period apart: what the machine takes, it takes from both.
    cyclictest -q -m -p 49 -i 2000 -D "$seconds" -h 20000 -a "$last" -t 1 > "$out/cyclictest" 2> /dev/null &
    cyclic=$!
    "$program" --port "$out/vehicle" --mocap natnet://127.0.0.1:15110/1 --no-battery-limits --take-off --duration "$seconds" --log "$out/flight.mcap" \
        --control 127.0.0.1:0 > "$out/rt" 2> "$out/warnings" &
    flight=$!
    largest=0
    while kill -0 $flight 2> /dev/null; do
        resident=$(awk '/VmRSS/ { print $2 }' /proc/$flight/status 2> /dev/null || echo 0)
        [ "${resident:-0}" -gt "$largest" ] && largest=$resident
        sleep 0.5
    done
    wait $cyclic $flight || true
    kill -INT $simulated
    wait $simulated || true
    sort -u "$out/warnings"
    printf 'cyclictest, wake-up   p50, p99, p99.9, max'
    quantiles "$out/cyclictest"
    grep -E '^(ticks|late)|^  |dropped' "$out/rt" | grep -v ' s  '
    grep '^IMU byte' "$out/sim" | sed 's/^/  /'
    awk -v kb=$largest 'BEGIN { printf "resident memory     %.1f MB\n", kb * 1024 / 1e6 }'
}

measure idle
stress-ng --cpu "$(nproc)" --vm 1 --io 1 --timeout $((seconds + 60)) --quiet &
measure "under stress-ng on every processor"
