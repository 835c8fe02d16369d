# make setup | data | demo | test | test-slow | docs | bench | cycles | figures | gallery | published | tutorials | real | relit | lamps | calibration | near |
# spectra | response | coverage | merl | first-order | orders | modes | cluster | platforms | package | crash | fuzz |
# constraints | audit | lowest: each sets up what it needs.
SHELL := /bin/bash
BIN := .venv/bin
READY := .venv/ready
PEERS := .venv/peers
LOWEST := .venv/lowest
TOOLS := .venv/pins
INSTALL := -m pip install --quiet --disable-pip-version-check --only-binary=:all:
OWN := --no-deps --no-build-isolation -e .

.PHONY: setup data demo test test-slow docs bench cycles real relit lamps calibration near spectra response coverage merl first-order orders modes cluster figures gallery viewer turning published tutorials schemas platforms package crash fuzz constraints audit lowest

setup: $(READY)

# Wheels only, of pinned versions and with the hashes of constraints.txt, the build backend too; then this checkout. The
# stamp is written last, so a broken set-up starts again.
$(READY): pyproject.toml constraints.txt packaging/pins.py .ci/venv .ci/llvm
	.ci/venv .venv
	$(BIN)/python packaging/pins.py 'hagoromo[dev]' build >.venv/pins.txt
	$(BIN)/python $(INSTALL) --require-hashes -r .venv/pins.txt
	$(BIN)/python $(INSTALL) $(OWN)
	.ci/llvm $(BIN)/python
	touch $@

# Real data beside the checkout: where each set comes from, its licence, whether its files are the right ones.
data: $(READY)
	$(BIN)/python -m tests.data

demo: $(READY)
	$(BIN)/hagoromo demo --out out/demo --force --open-page

test: $(READY)
	$(BIN)/ruff check --quiet .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports --no-cache
	$(BIN)/pytest -n 2 --dist worksteal -m "not slow"

# Types as Windows and macOS have them: a call that one of them lacks fails (a minute; part of the workflow).
platforms: $(READY)
	$(BIN)/pyright --pythonpath $(BIN)/python --pythonplatform Windows hagoromo hagoromo_figures hagoromo_start
	$(BIN)/pyright --pythonpath $(BIN)/python --pythonplatform Darwin hagoromo hagoromo_figures hagoromo_start

# The wheel and the sdist, into out/package; before, the tests that look into both and install the wheel.
package: $(READY)
	$(BIN)/pytest -q tests/app/test_packaging.py
	$(BIN)/python -c 'from hatchling.build import build_sdist, build_wheel; build_sdist("out/package"); build_wheel("out/package")'
	@ls out/package

# Spoilt files of every kind, more and more seeds (a quarter of an hour): each is read, or refused in one line.
fuzz: $(READY)
	$(BIN)/python -m fuzz --minutes 15 --processes 2 --keep out/fuzz

test-slow: $(READY)
	$(BIN)/pytest -n 2 --dist worksteal -m slow

# The site of the documents, into out/docs; a dead link or a public name without a docstring fails.
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo out/docs/index.html

# The march, how it grows, what bounds it, and its peers (a quarter of an hour; 6 GiB): docs/performance.md.
bench: $(PEERS)
	$(BIN)/python benchmarks/march.py
	$(BIN)/python benchmarks/bound.py
	$(BIN)/python benchmarks/scaling.py
	$(BIN)/python benchmarks/scale.py
	$(BIN)/python benchmarks/open_box.py --out out/bench/open_box.json
	$(BIN)/python benchmarks/equal_error.py
	$(BIN)/python benchmarks/orders.py
	$(BIN)/python benchmarks/formats.py
	$(BIN)/python benchmarks/peers.py --out out/bench
	$(BIN)/python benchmarks/page.py

# Blender's Cycles for benchmarks/orders.py, in a Python environment of its own: bpy needs another NumPy (1 GB).
cycles: $(READY)
	$(BIN)/python -m venv .venv/cycles
	.venv/cycles/bin/python $(INSTALL) --require-hashes -r benchmarks/cycles.txt

$(PEERS): $(READY)
	$(BIN)/python packaging/pins.py 'hagoromo[bench]' >.venv/peers.txt
	$(BIN)/python $(INSTALL) --require-hashes -r .venv/peers.txt
	touch $@

# constraints.txt anew, with the hashes of all wheels, and packaging/lowest.txt; UPGRADE=1 takes the newest versions.
constraints: $(TOOLS)/ready
	$(TOOLS)/bin/python packaging/constraints.py $(if $(UPGRADE),--upgrade)

# Known vulnerabilities of what constraints.txt pins (a minute; part of a workflow that also runs every week).
audit: $(TOOLS)/ready
	$(TOOLS)/bin/pip-audit --requirement constraints.txt --require-hashes --disable-pip --progress-spinner off

$(TOOLS)/ready: constraints.txt packaging/pins.py .ci/venv
	.ci/venv $(TOOLS)
	$(TOOLS)/bin/python packaging/pins.py pins >$(TOOLS)/pins.txt
	$(TOOLS)/bin/python $(INSTALL) --require-hashes -r $(TOOLS)/pins.txt
	touch $@

# The quick tests with the lowest versions that pyproject.toml allows, on Python 3.11, in an environment of its own.
lowest:
	.ci/venv $(LOWEST)
	$(LOWEST)/bin/python $(INSTALL) --require-hashes -r packaging/lowest.txt
	$(LOWEST)/bin/python $(INSTALL) $(OWN)
	.ci/llvm $(LOWEST)/bin/python
	$(LOWEST)/bin/pytest -n 2 --dist worksteal -m "not slow"

# Real photographs: every one predicted from the eleven others (minutes; needs the uw_psm set beside the checkout).
real: $(READY)
	$(BIN)/python -m studies.real ../shared/data/uw_psm --out out/real --force

# The same objects as volume boxes under lamps that were held out, beside the photographs; a page each. Then what limits
# the predictions: the table of docs/relighting.md.
relit: $(READY)
	$(BIN)/python -m studies.relit_objects ../shared/data/uw_psm --out out/relit --force
	$(BIN)/python -m studies.relit_objects ../shared/data/uw_psm --out out/relit_rig --objects gray buddha cat horse owl rock --rig --force
	$(BIN)/python -m studies.relit_objects ../shared/data/uw_psm --out out/relit_rig_quarter --objects gray buddha cat horse owl rock --rig --shrink 4 --force
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.relit_limits ../shared/data/uw_psm --shrink 4 --out out/relit_limits --force

# How far readings of the same real lamps agree: of a mirror ball, of a grey ball, of the objects themselves.
lamps: $(READY)
	$(BIN)/python -m studies.lamps ../shared/data/uw_psm --out out/lamps.json --force

# Boards in blurred photographs, and lamps on mirror balls with streaks of glare, simulated (a minute).
calibration: $(READY)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.calibration --out out/calibration.json --force

# Normals and depth under near lamps in perspective, simulated, highlights from narrow to wide (minutes).
near: $(READY)
	$(BIN)/python -m studies.near_lamps --out out/near_lamps.json --leds ../shared/data/near_ps_leds --force

# Spectra from camera colours, over many cameras (minutes; needs the camera data beside the checkout).
spectra: $(READY)
	$(BIN)/python -m studies.spectra ../shared/data --out out/spectra --force

# Cameras' responses from readings without faults and with, over 7 of the 14 cameras on which fewest choices were made
# (minutes; needs the camera data beside the checkout): docs/response.md.
response: $(READY)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.response_study ../shared/data --out out/response --force
	cp out/response/response.md docs/ && cp out/response/response.png docs/figures/

# How often the intervals of materials hold the truth, over 1800 simulations (minutes): docs/coverage.md.
coverage: $(READY)
	$(BIN)/python -m studies.coverage --out out/coverage --force
	cp out/coverage/coverage.md docs/ && cp out/coverage/coverage.png docs/figures/

# The march against an oracle of its equations in float64, before and now (a minute): docs/first_order.md.
first-order: $(READY)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.first_order --out out/first_order --force
	cp out/first_order/first_order.md docs/ && cp out/first_order/*.png docs/figures/

# Recipes by modes march, full and path, side by side (minutes): docs/orders.md.
orders: $(READY)
	$(BIN)/python -m studies.orders examples/recipes --out out/orders --force
	cp out/orders/orders.md docs/ && cp out/orders/orders.png out/orders/orders_colour.png docs/figures/

# The gallery and figures 6, 7 and 8 by modes march, full and path (an hour, and a demo before it): docs/modes.md. What is
# in out/modes stays as it is.
modes: $(READY)
	test -e out/demo/measure || $(BIN)/hagoromo demo --out out/demo --force
	$(BIN)/python -m studies.modes out/demo examples/recipes --out out/modes
	mkdir -p docs/figures/modes && cp out/modes/modes.md docs/ && cp out/modes/modes/*.jpg docs/figures/modes/

# Workers on this machine, one of them killed, and a simulation of many (minutes): docs/cluster.md.
cluster: $(READY)
	$(BIN)/python -m studies.cluster --out out/cluster --force
	cp out/cluster/cluster.md docs/ && cp out/cluster/cluster.png docs/figures/

# 80 measured materials, fitted with our model and with GGX + Lambert (an hour, resumed where it was stopped; needs the fits beside): docs/merl.md.
merl: $(READY)
	$(BIN)/python -m studies.merl ../shared/data/merl_fits --out out/merl --force
	cp out/merl/merl.md docs/ && cp out/merl/merl.png docs/figures/

# The figures of README and docs/figures.md (half an hour; 8 GiB); their EXR files and the report lie in out/figures.
figures: $(READY)
	$(BIN)/hagoromo demo --out out/figures --size full --force
	$(BIN)/python -m hagoromo_figures.demo.plates out/figures docs

# The pictures of docs/howto/view.md, of the viewer in Chromium (a minute).
viewer: $(READY)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.viewer --out out/viewer --force
	for name in scene image photograph measurement; do cp out/viewer/$$name.jpg docs/figures/view_$$name.jpg; done

# The film of docs/howto/film.md and docs/figures.md: figure 8, turning (half an hour after a demo, whose folder it takes).
turning: $(READY)
	test -e out/demo/measure || $(BIN)/hagoromo demo --out out/demo --force
	$(BIN)/python -m hagoromo_figures.demo.turning out/demo out/turning docs

# The page of docs/howto/publish.md, made and opened in Chromium (minutes).
published: $(READY)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.published --out out/published --force
	cp out/published/published.jpg docs/figures/

# The pictures of the tutorials, by the commands of their pages (minutes).
tutorials: $(READY)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.tutorial_pictures --out out/tutorials --force
	cp out/tutorials/tutorial_dome.jpg out/tutorials/tutorial_skin.png docs/figures/

# Every recipe close up, whole and under a moving lamp, and what it costs (a quarter of an hour): docs/gallery.md.
gallery: $(READY)
	$(BIN)/python -m studies.gallery.gallery examples/recipes --out docs

# The JSON Schemas of all files, made from the records that read them; a test holds that they are up to date.
schemas: $(READY)
	$(BIN)/hagoromo schema --out docs/schemas

# Every verb that writes, killed at 30 of its file operations (slow verbs: 2 to 10), and with a disk that is full after
# so many bytes of a file (half an hour): docs/reference/writing.md, docs/faults.md.
crash: $(READY)
	$(BIN)/python -m fuzz.crash --most 30
	$(BIN)/python -m fuzz.crash --full
