#!/bin/sh
# Measures the loop's timing on this machine, and that of a thread that only sleeps (same priority,
# period and processor): idle, with compilers and disk writes on every processor, and with
# stress-ng. On a virtual machine the host may stop a processor; the time that it took is shown.
# Usage: benchmarks/rt.sh [seconds a run] [idle|compile|stress ...]
set -eu
seconds=${1:-20}
[ $# -gt 0 ] && shift
runs=${*:-idle compile stress}
case " $runs " in *" stress "*)
    command -v stress-ng > /dev/null || {
        echo "stress-ng is missing: sudo apt-get install stress-ng, or leave the run out: benchmarks/rt.sh $seconds idle compile" >&2
        exit 2
    }
    ;;
esac
folder=${TILTHEX_PROGRAMS:-target/release}
program=$folder/tilthex-rt
vehicle=$folder/tilthex-sim
out=$(mktemp -d)
trap 'unload; kill $(jobs -p) 2> /dev/null || true; rm -rf "$out"' EXIT
load=

# A real vehicle does not wait for the processors of this computer. Give the simulated one priority
# where that is allowed.
first=
chrt --fifo 20 true 2> /dev/null && first="chrt --fifo 20"

# Starts a load in its own session, so that it ends with all of its processes.
load() {
    setsid sh -c "$1" > /dev/null 2>&1 &
    load=$!
}

unload() {
    [ -z "$load" ] || kill -- "-$load" 2> /dev/null || true
    load=
}

# Time that the host of a virtual machine took from each processor so far, ms.
stolen() {
    awk -v tick="$(getconf CLK_TCK)" '/^cpu[0-9]/ { printf "%s %d ms  ", $1, 1000 * $9 / tick }' /proc/stat
}

measure() {
    echo "== $1"
    before=$(stolen)
    end=$(($(date +%s) + seconds))
    number=1
    # If a fault ends a flight early, the next flight takes the rest of the time.
    while left=$((end - $(date +%s))) && [ $left -gt 0 ]; do
        echo "flight $number"
        fly $left
        number=$((number + 1))
    done
    echo "stolen by the host  before: $before"
    echo "                    after:  $(stolen)"
}

fly() {
    # The vehicle is its own program, as a real one is its own machine; a socket avoids the
    # terminal's work queue.
    $first "$vehicle" --socket "$out/vehicle" --mocap natnet://127.0.0.1:15110/1 > "$out/sim" 2>&1 &
    simulated=$!
    sleep 1
    # The sleeping thread wakes half a period later, so that the machine disturbs both equally.
    "$program" --reference --port "unix:$out/vehicle" --mocap natnet://127.0.0.1:15110/1 --no-battery-limits --take-off --duration "$1" --log "$out/flight.mcap" --overwrite \
        --control 127.0.0.1:0 > "$out/rt" 2> "$out/warnings" &
    flight=$!
    largest=0
    while kill -0 $flight 2> /dev/null; do
        resident=$(awk '/VmRSS/ { print $2 }' /proc/$flight/status 2> /dev/null || echo 0)
        [ "${resident:-0}" -gt "$largest" ] && largest=$resident
        sleep 0.5
    done
    wait $flight || true
    kill -INT $simulated
    wait $simulated || true
    rm -f "$out/vehicle"
    sort -u "$out/warnings"
    grep -E '^(ticks|late)|^  |not logged' "$out/rt" | grep -v ' s  '
    grep -v '^/dev' "$out/sim" | sed 's/^/  /'
    awk -v kb=$largest 'BEGIN { printf "resident memory     %.1f MB\n", kb * 1024 / 1e6 }'
}

for run in $runs; do
    case $run in
    idle) measure idle ;;
    compile)
        # Other compilers on the machine are not stopped.
        load "while true; do rm -rf $out/build; cargo build --workspace --locked --quiet --target-dir $out/build; done"
        measure "beside cargo build of the workspace, in a loop"
        ;;
    stress)
        load "exec stress-ng --exec 8 --mmap 4 --mmap-bytes 64M --pipe 4 --cpu 4 --quiet"
        measure "beside stress-ng --exec 8 --mmap 4 --mmap-bytes 64M --pipe 4 --cpu 4"
        ;;
    *)
        echo "no run is named $run; expected idle, compile or stress" >&2
        exit 2
        ;;
    esac
    unload
done
