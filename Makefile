# make demo | make messages | make test | make test-fast | make test-distro | make test-lowest | make bench | make lint | make build | make docs | make reference | make figures
#
# Everything lives in .venv, which is made when it is missing or what it is made from has changed. Each
# target installs what it needs: demo and the nodes what runs, the others tests and tools as well.

# The ROS distribution whose wheels are installed, each into an environment of its own.
DISTRO  ?= jazzy
VENV    := .venv$(if $(filter-out jazzy,$(DISTRO)),-$(DISTRO))
ROS     := ros$(if $(filter-out jazzy,$(DISTRO)),-$(DISTRO))
BIN     := $(VENV)/bin
OUT     ?= out/demo
DEMO    ?= bags/flat
# Workers of the tests: one more than processors, since tests over DDS wait at times.
JOBS    ?= $(shell echo $$(($$(nproc) + 1)))
# Environments are not compiled as a whole: Python compiles what it imports.
INSTALL := $(BIN)/python tools/install.py
# Messages that are not on the package index: those of the nodes, and public ones that only tests need, each after those that it needs.
GENERATE    := $(BIN)/python tools/generate_interfaces.py
INTERFACES  := tools/definitions/tf2_msgs interfaces
DEFINITIONS := $(addprefix tccm_ros/ros/public_definitions/,object_recognition_msgs octomap_msgs moveit_msgs vision_msgs) $(addprefix test/interfaces/definitions/,control_msgs nav2_msgs)
STAMP   := $(VENV)/.installed
TOOLS   := $(VENV)/.installed-tools
TESTING := $(VENV)/.installed-for-tests
DOCS    := $(VENV)/.installed-docs
# rclpy finds its plugins through the ament index, which the wheels put into the environment.
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)$(if $(AMENT_PREFIX_PATH),:$(AMENT_PREFIX_PATH))
export MPLBACKEND := Agg
# Bytecode is kept also where the environment forbids it.
export PYTHONDONTWRITEBYTECODE :=

# The newest supported interpreter that really starts.
PYTHON ?= $(firstword $(foreach p,python3.12 python3.11 python3,$(if $(shell $(p) -c 'import sys, venv, ensurepip; sys.version_info >= (3, 11) and print(1)' 2>/dev/null),$(p))))

.PHONY: demo messages test test-fast test-distro test-lowest bench lint build docs reference figures clean

# The replay needs no ROS messages.
demo: $(VENV)/.wheels
	@$(BIN)/tccm replay $(DEMO) --out $(OUT)

# The messages of the nodes, which work without them but for typed topics and questions. What cannot be generated is an error here alone.
messages: $(STAMP)
	@$(GENERATE) $(INTERFACES) $(if $(wildcard $(TESTING)),$(DEFINITIONS))

# A worker has the tests of a file in one piece, so that what a module makes is made once; who is done takes from others.
PYTEST := -m pytest -n $(JOBS) --dist worksteal

# Of another distribution than Jazzy the tests with rclpy; nothing else depends on it.
TESTS := $(if $(filter jazzy,$(DISTRO)),test,test/nodes test/interfaces)

test: $(TESTING)
	@$(BIN)/python $(PYTEST) $(TESTS)

# For the inner loop: without DDS, whole recordings and installations (`SLOW` in test/conftest.py).
test-fast: $(TESTING)
	@$(BIN)/python $(PYTEST) -m "not slow" test

# Each node once: make test-distro DISTRO=kilted.
test-distro: $(VENV)/.installed-pytest
	@$(BIN)/python $(PYTEST) -m every_distro $$(grep -rl every_distro test/nodes test/interfaces --include='*.py')

# The lowest versions that setup.py allows, in an environment of their own.
test-lowest: $(VENV)/.wheels
	@$(BIN)/python tools/lowest_versions.py > $(VENV)/lowest.txt
	@$(BIN)/python -m venv --clear $(VENV)-lowest
	@$(VENV)-lowest/bin/python tools/install.py . -c $(VENV)/lowest.txt
	@$(VENV)-lowest/bin/tccm demo --no-browser --out out/lowest

bench: $(TOOLS) $(STAMP)
	@$(BIN)/python bench/run.py

lint: $(TOOLS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/vulture
	$(BIN)/python tools/check_words.py --all --lines

# What `ros2 run` needs: executables in lib/tccm_ros and a marker in the ament index.
build: $(TOOLS)
	$(BIN)/colcon build --packages-select tccm_ros --event-handlers console_cohesion+

# Wheels first; then tf2_msgs and tccm_interfaces, which are not on the package index. All else works without them.
$(STAMP): $(VENV)/.wheels tools/generate_interfaces.py $(wildcard tools/definitions/*/*/* interfaces/*.* interfaces/*/*)
	-@$(GENERATE) $(INTERFACES)
	@touch $(STAMP)

# Tests, with the library that reads door signs, lint and build.
$(TOOLS): $(VENV)/.wheels requirements-test.txt
	@echo "installing tests and tools into $(VENV) (once)"
	@$(INSTALL) -r requirements-test.txt -e '.[$(ROS),signs]'
	@touch $(TOOLS)

# These tests need pytest and the pages of the nodes, no other tool.
$(VENV)/.installed-pytest: $(STAMP) requirements-test.txt
	@grep -E '^(pytest|hypothesis)' requirements-test.txt > $(VENV)/pytest.txt
	@$(INSTALL) -r $(VENV)/pytest.txt -e '.[view]'
	@touch $@

$(TESTING): $(TOOLS) $(STAMP) $(foreach p,$(DEFINITIONS),$(wildcard $(p)/*/*))
	-@$(GENERATE) $(DEFINITIONS)
	@touch $(TESTING)

$(VENV)/.wheels: setup.py pyproject.toml
	@test -n "$(PYTHON)" || { echo "no Python 3.11 or 3.12 with venv found; install python3 and python3-venv, or say make PYTHON=..."; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing into $(VENV) (a minute or two, once)"
	@$(INSTALL) -e '.[$(ROS)]'
	@touch $(VENV)/.wheels

clean:
	rm -rf $(VENV) build install log out

# What is made from the code: the shipped YAML, and the pages of parameters, commands and file schemas.
reference: $(STAMP)
	@$(BIN)/tccm parameters > config/tccm.yaml
	@$(BIN)/python tools/make_schemas.py
	@$(BIN)/python tools/make_reference.py
	@$(BIN)/python tools/document_interfaces.py

# The pictures of docs/design/how_it_works.md and structure.md; other pages name the command of each picture.
figures: demo
	@$(BIN)/python tools/draw_figures.py $(OUT)
	@$(BIN)/python tools/draw_architecture.py

# The documentation as a site, with search and the Python API: out/docs. Dead links are errors (--quiet would hide them).
docs: $(DOCS)
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build
	@echo "documentation  $(BIN)/python -m http.server -d out/docs  (then http://localhost:8000)"

$(DOCS): requirements-docs.txt $(STAMP)
	@$(INSTALL) -r requirements-docs.txt
	@touch $(DOCS)
