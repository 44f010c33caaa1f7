# What a person types. Needs cargo, Python 3.10+ and make, nothing else.
PYTHON ?= python3
VENV := .venv
# Flights of the fault campaign.
N ?= 10000
BIN := $(VENV)/bin
export PATH := $(CURDIR)/$(BIN):$(PATH)

.PHONY: help demo test lint rust-test python-test bench bench-rt campaign clean

help:
	@echo "make demo      fly the simulated Tilt-Hex, push its tool, print a summary"
	@echo "make test      everything: lints, Rust and Python tests, stubs"
	@echo "make bench     speed, as ratios against NumPy in the same run"
	@echo "make bench-rt  the loop's timing on this machine"
	@echo "make campaign  the fault campaign"
	@echo "make clean     remove what was built"

demo:
	mkdir -p out
	cargo run --release --locked -p tilthex-rt --bin tilthex-rt -- \
		--sim --duration 20 --pushes examples/push.toml --log out/demo.mcap

test: lint rust-test python-test

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
	ruff check .
	ruff format --check .
	mypy
	cd tests && python -m mypy.stubtest --concise tilthex._core

rust-test: proof
	cargo test --workspace --locked --quiet

# Links only if no step function of the core has a path to a panic.
.PHONY: proof
proof:
	cargo build --profile proof --locked --quiet -p tilthex-proof --features proof

python-test: install
	python -m pytest

bench: install
	python -m benchmarks
	cargo bench --locked --quiet -p tilthex-core -p tilthex-sim --bench ukf --bench allocation --bench control

bench-rt:
	cargo build --release --locked -p tilthex-rt
	benchmarks/rt.sh

campaign:
	cargo run --release --locked -p tilthex-rt --bin tilthex-rt -- campaign --number $(N)

clean:
	cargo clean
	rm -rf $(VENV) dist out
