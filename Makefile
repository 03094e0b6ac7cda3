# The only two commands a newcomer needs: `make demo` and `make test`. Each sets itself up.
# `make faults` breaks the emulated robot in every way of docs/reliability.md, on every bus that there is.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV   ?= .venv
BIN    := $(VENV)/bin

.PHONY: demo test faults mutants setup clean
setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[sim,test,field]'
	touch $@

demo: setup
	$(BIN)/truearc demo --out report

test: setup
	$(BIN)/python -m pytest

faults: setup
	$(BIN)/python benchmarks/fault_matrix.py $(FAULTS)

mutants: setup
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[sim,test,mutants]'
	$(BIN)/mutmut run
	$(BIN)/mutmut results

clean:
	rm -rf mutants $(VENV) report sessions .truearc_cache
