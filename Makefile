# What a person types. Needs cargo, Python 3.10+ and make, nothing else.
PYTHON ?= python3
VENV := .venv
# Flights of the fault campaign, and the seed of the first.
N ?= 10000
SEED ?= 1
# A target without an operating system, for the crates that need none.
NO_STD_TARGET ?= thumbv7em-none-eabihf
BIN := $(VENV)/bin
# Whether the documentation site has the pages of the Rust crates.
RUST ?= 1
export PATH := $(CURDIR)/$(BIN):$(PATH)

.PHONY: help demo test lint rust-test python-test bench bench-rt campaign results wheel clean

help:
	@echo "make demo      fly the simulated Tilt-Hex, push its tool, print a summary"
	@echo "make test      everything: lints, Rust and Python tests, stubs"
	@echo "make browser-test  tilthex view in a headless Chromium"
	@echo "make commands-test  every command of README and docs, also those that take long"
	@echo "make cluster-test  campaigns on several workers, some of which are killed"
	@echo "make bench     speed, as ratios against NumPy in the same run"
	@echo "make bench-rt  the loop's timing on this machine"
	@echo "make onboard   the blocks on a Cortex-M7 in QEMU: the host's bits, instructions, memory"
	@echo "make campaign  the fault campaign: N flights, from SEED on"
	@echo "make results   runs what docs/results shows, and writes it"
	@echo "make docs      the documentation site, into site; RUST=0 leaves out the pages of the Rust crates"
	@echo "make gallery   the videos of the site's gallery"
	@echo "make wheel     an installable wheel with both programs, into dist"
	@echo "make clean     remove what was built"

demo:
	mkdir -p out
	cargo run --release --locked -p tilthex-rt --bin tilthex-rt -- \
		--sim --take-off --duration 20 --pushes examples/push.toml --overwrite --log out/demo.mcap

test: lint rust-test python-test

# With --jobs, only the proof is built beside the lints: both leave one core idle, and tests must be alone.
ifneq ($(filter test,$(MAKECMDGOALS)),)
rust-test: lint
python-test: rust-test
endif

# Reinstalled on every run: cargo and maturin build only what has changed.
$(BIN)/pip:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip

.PHONY: install
install: $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check '.[test]'

lint: install
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --locked --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --quiet
	@if [ -d "$$(rustc --print sysroot)/lib/rustlib/$(NO_STD_TARGET)" ]; then $(MAKE) no-std; \
	else echo "no-std: left out, $(NO_STD_TARGET) is not installed here"; fi
	ruff check .
	ruff format --check .
	mypy
	cd tests && python -m mypy.stubtest --concise tilthex._core

rust-test: proof
	cargo test --workspace --locked --quiet

# Everything, without tests: what the minimum compiler must take.
.PHONY: build
build:
	cargo build --workspace --locked --quiet

# The crates that fly need no operating system and no allocator.
.PHONY: no-std
no-std:
	cargo build -p tilthex-core -p tilthex-link -p tilthex-firmware --target $(NO_STD_TARGET) --locked --quiet

.PHONY: minimum-compiler
minimum-compiler:
	@sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml

# With the oldest versions of all dependencies that Cargo.toml allows; changes Cargo.lock.
.PHONY: minimal-versions
minimal-versions:
	cargo +nightly update -Z direct-minimal-versions
	cargo build --workspace --quiet

# Licences and known defects of the dependencies.
.PHONY: deny
deny:
	cargo install --locked --quiet cargo-deny
	cargo deny --all-features check licenses bans sources

# Links only if no step function of the core has a path to a panic.
.PHONY: proof
proof:
	cargo build --profile proof --locked --quiet -p tilthex-proof --features proof

# At most two flights in real time at once, and nothing else beside them. If the machine stands still for 0.1 s, the program finds a
# fault and lands: a test that fails with one of these faults is flown again, twice at most, and named. No other failure is.
STALLED := loop overrun|lift-off|line late|IMU late|IMU silent|wrong speed|pose lost|pose late
python-test: install
	python -m pytest -m "not real_time" -n 2 --dist loadfile
	python -m pytest -m real_time -n 2 --dist loadfile --reruns 2 --only-rerun '$(STALLED)' -rR

# The pages of tilthex view in a headless Chromium; TILTHEX_WRITE_DOCS=1 takes the pictures of docs/howto/view.md.
.PHONY: browser-test
browser-test: install
	TILTHEX_BROWSER=1 python -m pytest -m real_time tests/test_view_flight.py tests/test_view_hand.py --reruns 2 \
		--only-rerun '$(STALLED)' -rsR

# The commands of the pages that take long: experiments, films, flights in real time.
.PHONY: commands-test
commands-test: install
	TILTHEX_COMMANDS=1 python -m pytest tests/test_commands.py --reruns 2 --only-rerun '$(STALLED)' -rR --durations=0

# Campaigns on workers of Dask and jobs of submitit, some of which are killed.
.PHONY: cluster-test
cluster-test: install
	$(BIN)/pip install --quiet --disable-pip-version-check '.[cluster]'
	python -m pytest tests/test_executors.py -rs

bench: install
	$(BIN)/pip install --quiet --disable-pip-version-check '.[bench]'
	python -m benchmarks
	cargo bench --locked --quiet -p tilthex-core -p tilthex-sim --bench ukf --bench allocation --bench control

bench-rt:
	cargo build --release --locked -p tilthex-rt
	benchmarks/rt.sh

# The blocks of the core on a microcontroller, in QEMU. Says which tool is missing, and installs nothing.
.PHONY: onboard
onboard:
	@benchmarks/onboard.sh

campaign:
	cargo run --release --locked -p tilthex-rt --bin tilthex-rt -- campaign --number $(N) --seed $(SEED)

wheel: $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check maturin cargo-zigbuild ziglang auditwheel abi3audit
	python packaging/wheel.py

results: install
	cargo build --release --locked --quiet -p tilthex-rt
	python -m benchmarks.results

# The site, with warnings as errors. The tutorials are run; KEEP=1 takes those that ran before.
.PHONY: docs
docs: $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check '.[docs]'
ifneq ($(RUST),0)
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --quiet
endif
	python packaging/pages.py $(if $(KEEP),--keep) $(if $(filter-out 0,$(RUST)),--rust)
	zensical build --clean --strict
ifneq ($(RUST),0)
	cp -r target/doc site/rust
endif

# The videos of the site's gallery, in out/gallery; rendered without a display.
.PHONY: gallery
gallery: $(BIN)/pip
	$(BIN)/pip install --quiet --disable-pip-version-check '.[docs]'
	tilthex experiment all --short --video --out out/gallery

clean:
	cargo clean
	rm -rf $(VENV) dist out site .cache
