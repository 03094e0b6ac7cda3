# The only two commands a newcomer needs: `make demo` and `make test`. Each sets itself up.
# `make test-long` runs the tests that `make test` leaves out (tests/README.md); CI runs both.
# `make golden` recomputes what was computed before, most of it at proof-1, through the command line, and compares.
# `make faults` breaks the emulated robot in every way of benchmarks/matrix, on every bus that there is.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV   ?= .venv
BIN    := $(VENV)/bin

.PHONY: demo test test-long golden faults mutants release-check setup clean
setup: $(VENV)/.installed

# all three distributions, editable; build/view shows static tools the import names. Bytecode comes with the first import: to
# compile all that is installed takes half of pip's time, and most of it is never imported.
$(VENV)/.installed: pyproject.toml proof/pyproject.toml frc/pyproject.toml constraints.txt tools/make_view.py
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[sim,video,test]' \
	    --editable proof --editable frc
	$(BIN)/python tools/make_view.py
	touch $@

demo: setup
	$(BIN)/truearc demo --out report --force

test: setup
	$(BIN)/python -m pytest -m "not slow"
	@echo "Not run here: tests that take long (make test-long). Skipped tests are above, with the reason."

test-long: setup
	$(BIN)/python -m pytest -m slow
	@echo "Not run here: the tests of make test. Skipped tests are above, with the reason."

golden: setup
	$(BIN)/python tests/golden/make.py $(GOLDEN)

faults: setup
	$(BIN)/python -m benchmarks.fault_matrix $(FAULTS)

mutants: setup
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[sim,test,mutants]'
	rm -rf build/mutants
	mkdir -p build/mutants
	cp -r pyproject.toml tests truearc build/mutants
	cp -r hw robot sim model_export build/mutants/truearc
	cd build/mutants && $(abspath $(BIN))/mutmut run && $(abspath $(BIN))/mutmut results

# needs the package index; every Python from 3.11 to 3.13 that is found
release-check:
	$(PYTHON) tools/release_check.py $(RELEASE)

clean:
	rm -rf build $(VENV) report sessions .truearc_cache
