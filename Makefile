# Targets set up their environment by themselves, from any Python >= 3.11 that has venv.

PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python
INSTALLED := $(VENV)/.installed
BENCH := .venv-bench
PINS ?= constraints.txt
OLDEST_NUMBA := 0.62.0
COMPILER_TESTS := tests/packaging/test_cache_trouble.py tests/packaging/test_cache_trust.py \
	tests/packaging/test_first_start.py tests/packaging/test_kernel_cache.py tests/packaging/test_other_numba.py \
	tests/numerics/test_vectors_of_lanes.py tests/numerics/test_elementary.py tests/numerics/test_transposition.py \
	tests/numerics/test_golden.py tests/numerics/test_switched.py tests/env/test_threads.py
# Words that the glossary has replaced, each with the field's word.
WORDS := docs/replaced_words.txt
SLOW := $(sort $(notdir $(patsubst %/,%,$(dir $(wildcard tests/*/test_*.py)))))
# Of changes that are not committed it is another one each time.
COMMIT := $(shell git describe --always --dirty=-$$(date +%s) --exclude='*' 2>/dev/null || date +%s)
CLIENTS := rl_zoo3 rllib skrl sweep tianshou torchrl

# The many processes that tests start load byte code instead of making it.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-slow test-browser test-processors test-clients $(CLIENTS) test-numba check docs bench tasks results clean
.DELETE_ON_ERROR:
.PRECIOUS: .venv-numba-%/.installed

demo: $(INSTALLED)
	$(RUN) -m agents demo

test: $(INSTALLED)
	$(RUN) -m pytest -n auto --dist loadfile --no-loadscope-reorder -m "not slow and not browser"

# All tests, for hours: rooms that have passed on this commit are not run again. With -k the others
# run after a failure too.
test-slow: $(SLOW:%=.slow/$(COMMIT)/%)

.slow/$(COMMIT)/%: $(INSTALLED)
	$(RUN) -m pytest -n auto --dist loadfile --no-loadscope-reorder -m "not browser" tests/$*
	@mkdir -p $(@D) && touch $@

# The web page of a report, and equations of the site, in Chromium.
test-browser: $(INSTALLED)
	$(RUN) -m pytest -m browser tests/agents/test_web_page.py tests/docs/test_site.py

# As other processors would run them, and twice while eight busy processes run: an hour or two.
test-processors: $(INSTALLED)
	$(RUN) tests/processors.py

# The pages on clients that the extras do not bring; one of them: make rllib.
test-clients: $(CLIENTS)

$(CLIENTS): %: .venv-%/.installed
	.venv-$*/bin/python -m pytest -W default tests/clients/test_$*.py

# The compiler's private names: with the oldest numba and the newest that pyproject.toml allows.
test-numba: test-numba-oldest test-numba-newest

test-numba-%: .venv-numba-%/.installed
	NUMBA_CACHE_DIR=.venv-numba-$*/cache .venv-numba-$*/bin/python -m pytest -n auto --dist loadfile -m "not slow" \
		$(COMPILER_TESTS)

check: $(INSTALLED)
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m pyright --pythonpath $(RUN)
	$(VENV)/bin/lint-imports
	$(VENV)/bin/codespell
	$(VENV)/bin/codespell -D $(WORDS) -S "$(WORDS),docs/_build,docs/gallery,*.json" -r "$$(sed -n '/ .*->/s/->.*/|/p' $(WORDS) | tr -d '\n')[\w'-]+" \
		README.md docs agents mm_gym configs benchmarks .github

# The site, in docs/_build/html: examples are run, warnings are errors.
docs: $(INSTALLED)
	PATH="$(CURDIR)/$(VENV)/bin:$$PATH" $(RUN) -m sphinx -q -W --keep-going -b html docs docs/_build/html

bench: $(BENCH)/.installed
	$(BENCH)/bin/python -m benchmarks

# The scores of the tasks, and the pages that show them.
tasks: $(INSTALLED)
	$(RUN) -m agents headroom
	$(RUN) -m agents ranking

# Ten trainings of each task by each algorithm, a day of one core, and their page.
results: $(INSTALLED)
	$(RUN) -m agents results configs/results.toml

# The stamp is younger than what was installed from, so a second call has nothing to do. Dependency
# groups need pip 25.1.
define install
@$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "mm_gym needs Python 3.11 or newer: make PYTHON=/path/to/it")'
@echo "Installing into $(1): some minutes, mostly of downloads"
test -x $(1)/bin/python || $(PYTHON) -m venv $(1)
$(1)/bin/python -m pip install --quiet --upgrade "pip>=25.1"
endef

$(INSTALLED): pyproject.toml constraints.txt
	$(call install,$(VENV))
	$(RUN) -m pip install --quiet -c constraints.txt -e ".[all]" --group dev
	@touch $@

# An environment of its own: a peer, gymnax, refuses the newest gymnasium.
$(BENCH)/.installed: pyproject.toml constraints.txt
	$(call install,$(BENCH))
	grep -v "^gymnasium==" constraints.txt > $(BENCH)/constraints.txt
	$(BENCH)/bin/python -m pip install --quiet -c $(BENCH)/constraints.txt -e ".[all]" --group bench
	@touch $@

# An environment for each: a client, RLlib, accepts one version of gymnasium only.
$(CLIENTS:%=.venv-%/.installed): .venv-%/.installed: pyproject.toml constraints.txt
	$(call install,.venv-$*)
	sed "/^gymnasium==/d" $(PINS) > .venv-$*/constraints.txt
	.venv-$*/bin/python -m pip install --quiet -c .venv-$*/constraints.txt -e . --group $*
	@touch $@

# Each numba allows some versions of NumPy only.
.venv-numba-%/.installed: pyproject.toml constraints.txt
	$(call install,.venv-numba-$*)
	sed "/^numba==/d;/^numpy==/d" $(PINS) > .venv-numba-$*/constraints.txt
	$(if $(filter oldest,$*),echo "numba==$(OLDEST_NUMBA)" >> .venv-numba-$*/constraints.txt)
	.venv-numba-$*/bin/python -m pip install --quiet -c .venv-numba-$*/constraints.txt -e . --group numba
	@touch $@

clean:
	rm -rf docs/_build docs/gallery $(VENV) $(BENCH) $(CLIENTS:%=.venv-%) .venv-numba-* dist .processors .slow .pytest_cache .ruff_cache .hypothesis
