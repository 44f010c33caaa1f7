#!/usr/bin/env bash
# `make onboard`: the blocks of the core on a Cortex-M7 with an FPU for f64 (QEMU, board mps2-an500), over a recorded
# flight, compared with the host bit for bit. Prints the instructions of each block, the stack and the memory.
# Where a tool is missing, it says so in one sentence and does nothing.
set -euo pipefail
cd "$(dirname "$0")/.."
target=thumbv7em-none-eabihf
out=out/onboard

leave_out() {
    echo "onboard: left out, $1"
    exit 0
}
command -v qemu-system-arm > /dev/null || leave_out "qemu-system-arm is not installed here (Debian: qemu-system-arm)"

# The host's compiler if it has the target, otherwise one that has the sources of the standard library.
build=(cargo build --profile onboard --locked --quiet -p tilthex-onboard --target "$target")
if [ -d "$(rustc --print sysroot)/lib/rustlib/$target" ]; then
    compiler=rustc
else
    compiler=${ONBOARD_RUSTC:-/usr/bin/rustc}
    sources="$("$compiler" --print sysroot 2> /dev/null || true)/lib/rustlib/src/rust/library/core"
    [ -d "$sources" ] || leave_out \
        "$target is not installed here (rustup target add $target, or Debian: rustc-web rust-web-src)"
    export RUSTC_BOOTSTRAP=1
    build+=(-Z build-std=core -Z build-std-features=compiler-builtins-mem)
fi
linker=$(command -v ld.lld || ls "$(rustc --print target-libdir)"/../bin/rust-lld 2> /dev/null || true)
[ -n "$linker" ] || leave_out "there is no ld.lld here (Debian: lld)"

flags="-C target-cpu=cortex-m7 -C linker=$linker -C link-arg=-Tcrates/tilthex-onboard/board.x"
flags+=" -C link-arg=--nmagic -C relocation-model=static"
RUSTC=$compiler CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS=$flags "${build[@]}"
# The firmware of a vehicle that flies itself has no board here: it must build.
RUSTC=$compiler CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS=$flags "${build[@]/tilthex-onboard/tilthex-firmware}"
unset RUSTC_BOOTSTRAP
cargo build --release --locked --quiet -p tilthex-onboard

mkdir -p "$out"
built=${CARGO_TARGET_DIR:-target}
host=$(realpath "$built/release/tilthex-onboard")
board=$(realpath "$built/$target/onboard/tilthex-onboard")
echo "board: Cortex-M7 (mps2-an500) in $(qemu-system-arm --version | head -1)"
echo "compiler: $("$compiler" --version)"
cd "$out"
rm -f board.bin
"$host" record flight.bin
# QEMU prints what the board prints to its standard error.
timeout 600 qemu-system-arm -machine mps2-an500 -display none -monitor none -serial none -icount shift=6 \
    -semihosting-config enable=on,target=native -kernel "$board" 2>&1
"$host" judge flight.bin board.bin
