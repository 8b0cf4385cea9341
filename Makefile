# glint: two commands for a newcomer, `make demo` and `make test`. Both do their own set-up.
#
#   make demo    build, train the bundled recording, evaluate, write demo/report.html
#   make test    the whole test suite (what CI runs)
#   make lint    formatting and clippy, warnings are errors
#   make soak    the recorder under load for 12 minutes: a late disk, busy loops, 200 kills
#   make peers   comparisons with Open3D, Embree and Mitsuba (installs them in .venv; needs ../shared/data)
#   make clean   remove what the commands made

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

CARGO ?= cargo
DEMO := demo
RECORDING := recordings/two-cans.glint
TRUTH := recordings/two-cans/truth
# Lobe width of the shinier half of the objects (recordings/README.md).
TRUTH_ALPHA := 0.02

TARGET_DIR := $(or $(CARGO_TARGET_DIR),target)
GLINT := $(TARGET_DIR)/release/glint
OPENNI2_HEADER := /usr/include/openni2/OniCAPI.h
SOAK := $(or $(TMPDIR),/tmp)/glint-soak.glint

# What a virtual environment here has comes first.
export PATH := $(CURDIR)/.venv/bin:$(PATH)

.PHONY: help setup build demo test test-openni2 lint python-modules camera-libraries soak peers clean

help:
	@sed -n 's/^#   make/make/p' $(firstword $(MAKEFILE_LIST))

# A Rust toolchain and a C compiler; the latter is installed where we may, else the one command is printed.
setup:
	@command -v $(CARGO) >/dev/null || { echo "no cargo: install a Rust toolchain of 1.95 or newer"; exit 2; }
	@command -v cc >/dev/null || { \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    apt-get update -qq && apt-get install -y -qq build-essential; \
	  else echo "no C compiler: run  sudo apt-get install build-essential"; exit 2; fi; }

build: setup
	$(CARGO) build --locked --release -p glint -p glintd

demo: build
	$(GLINT) train $(RECORDING) -o $(DEMO)/run --profile draft --overwrite
	$(GLINT) eval $(DEMO)/run --truth $(TRUTH) --truth-alpha $(TRUTH_ALPHA)
	$(GLINT) report $(DEMO)/run -o $(DEMO)/report.html
	@echo "open $(DEMO)/report.html"

# The readers in Python are tests too; where their modules cannot be had, those tests say that they are skipped.
python-modules:
	@python3 -c "import numpy, zstandard" 2>/dev/null || .venv/bin/python -c "import numpy, zstandard" 2>/dev/null \
	  || { python3 -m venv .venv && .venv/bin/pip install --quiet numpy zstandard; } \
	  || echo "no numpy and zstandard for python3: the tests of the Python readers will be skipped"

# libusb to stand in front of and OpenNI2 to compare with, where they may be installed; tests that need them say else
# that they are skipped.
camera-libraries:
	@{ pkg-config --exists libusb-1.0 2>/dev/null && test -e $(OPENNI2_HEADER); } || { \
	  [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt-get update -qq \
	  && apt-get install -y -qq pkg-config libusb-1.0-0-dev libopenni2-dev libopenni2-0 >/dev/null; } \
	  || echo "no libusb-1.0-0-dev and libopenni2-dev: tests with the unmodified driver of OpenNI2 will be skipped"

# The hard cases run a second time with release arithmetic and overflow checks: fma, inlining and overflow
# differ. The trainer is tested in that profile alone: a training run without optimisation takes minutes.
test: setup python-modules camera-libraries
	$(CARGO) test --locked --workspace --exclude glint
	$(CARGO) test --locked --workspace --exclude glint --profile release-checked --tests -- hc_
	$(CARGO) test --locked --profile release-checked -p glint
	$(MAKE) test-openni2

# A directory for the build script of openni2-sys; the linker looks into its own as well.
test-openni2: export OPENNI2_REDIST ?= /usr/lib
test-openni2:
	@test -e $(OPENNI2_HEADER) || { echo "skipped: glintd with OpenNI2 (no libopenni2-dev)"; exit 0; } \
	  && $(CARGO) test --locked -p glintd --features openni2 --lib --test openni2

lint: setup
	$(CARGO) fmt --all --check
	$(CARGO) clippy --locked --workspace --all-targets -- -D warnings

# Ten minutes of the bundled recording, round and round at the speed of the camera; then 200 kills.
soak: setup
	rm -f $(SOAK)
	$(CARGO) run --locked --release -p glintd --example soak -- $(RECORDING) $(SOAK) 600
	rm -f $(SOAK)
	GLINT_KILLS=200 GLINT_KILL_SOURCE=$(CURDIR)/$(RECORDING) \
	  $(CARGO) test --locked --release -p glintd --test program -- kill --nocapture

peers: setup
	python3 -m venv .venv
	.venv/bin/pip install --quiet open3d embreex mitsuba numpy
	.venv/bin/python tests/peers/fusion_open3d.py ../shared/data/redkitchen
	.venv/bin/python tests/peers/tracking_open3d.py ../shared/data/redkitchen
	.venv/bin/python tests/peers/raycast_embree.py
	.venv/bin/python tests/peers/radiance_mitsuba.py

clean:
	rm -rf $(DEMO) .venv
	$(CARGO) clean
