# make demo: install, perceive and render the bundled photos, fit a film, print the paths of gallery and fit
# make test: install what tests need, a browser too, lint, type-check, run the tests that are not slow
# make test-slow: the slow tests alone
# make docs: build the site of docs/ into out/site, with strict links
# make train: draw and render pictures, train the networks that find and name objects and export them; 4 hours on two cores; needs PHYSGEN_MATERIAL
# make studio: render the bundled photos and their truth again, from scratch, into out/studio, and compare; hours, and LLVM
PYTHON ?= python3
BIN = .venv/bin
OUT = out/demo
LEFT_OUT = cans cups kitchen marbles pendulum pyramid ramp seesaw shelf toy-car
# a film of other values than the scene's, for the fit to find
PUCK = scenes/physics/18-puck.yaml
FILMED = --set world.table.friction=0.2 --set "objects.disc.velocity=[300, 60]" --set world.duration=0.5 --set render.frames=15
TORCH = torch==2.13.0
# each worker begins with half of the list of tests, so that the tests of a module share its fixtures
PYTEST = $(BIN)/pytest -n auto --dist worksteal
# as the command has it: each worker of pytest has a core, and more threads only wait, busily
export OPENBLAS_NUM_THREADS ?= 1
# without compiled modules on disk, each process that a test starts compiles physgen
# again, and each worker of pytest rewrites the assertions of all tests again
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-slow browser docs bench studio train clean

demo: .venv/.demo
	mkdir -p $(OUT)/perceived
	$(BIN)/physgen perceive scenes/billiards/photo.png -o $(OUT)/perceived/billiards-perceived.yaml
	$(BIN)/physgen perceive scenes/dominoes/photo.png -o $(OUT)/perceived/dominoes-perceived.yaml
	$(BIN)/physgen render $(OUT)/perceived/*.yaml -o $(OUT) --jobs 2
	$(BIN)/physgen render $(filter-out $(LEFT_OUT:%=scenes/%/scene.yaml),$(wildcard scenes/*/scene.yaml)) -o $(OUT) --jobs 2
	$(BIN)/physgen render $(PUCK) -o $(OUT)/fit/film.mp4 --report none $(FILMED)
	$(BIN)/physgen fit $(PUCK) $(OUT)/fit/film.mp4 --free velocity,table -o $(OUT)/fit/puck.yaml
	@echo
	@echo "fit: $(CURDIR)/$(OUT)/fit/puck/report.html"
	@echo "gallery: $(CURDIR)/$(OUT)/index.html"

# mypy runs beside the tests: with an empty cache it takes a minute of one core
test: .venv/.test browser
	$(BIN)/ruff check .
	@mkdir -p out
	$(BIN)/mypy >out/types.txt 2>&1 & types=$$!; $(PYTEST) -m "not slow" </dev/null; tests=$$?; \
	wait $$types; types=$$?; cat out/types.txt; exit $$((tests ? tests : types))

test-slow: .venv/.test browser
	$(PYTEST) -m slow </dev/null

browser: .venv/.test
	@$(BIN)/python tests/install_browser.py </dev/null

docs: .venv/.docs
	$(BIN)/python benchmarks/scene_reference.py > docs/scene.md
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "site: $(CURDIR)/out/site/index.html"

bench: .venv/.test
	$(BIN)/python benchmarks/run.py

studio: .venv/.studio
	$(BIN)/python studio/make.py -o out/studio

SEG = studio/segmentation
train: .venv/.studio
	$(BIN)/python -m pip install --quiet $(TORCH)
	$(BIN)/python $(SEG)/gather.py --drawn 4000 -o out/segmentation/drawn
	$(BIN)/python $(SEG)/homes/make.py --count 340 --seed 0 --size 320 -o out/segmentation/homes --jobs 2
	$(BIN)/python $(SEG)/gather.py --pictures out/segmentation/homes -o out/segmentation/homes-store
	$(BIN)/python $(SEG)/coco.py -o out/segmentation/coco
	$(BIN)/python $(SEG)/train.py out/segmentation/drawn=0.25 out/segmentation/homes-store=0.3 out/segmentation/coco=0.45 --steps 3200 -o out/segmentation
	$(BIN)/python $(SEG)/export.py out/segmentation/weights.pt
	$(BIN)/python $(SEG)/cutout.py out/segmentation/homes-store=0.35 out/segmentation/drawn=0.15 --steps 5000 -o out/segmentation
	$(BIN)/python $(SEG)/export.py out/segmentation/cutout.pt
	$(BIN)/python $(SEG)/cutout.py out/segmentation/homes-store=0.35 out/segmentation/drawn=0.15 --more --steps 1500 -o out/segmentation/more
	$(BIN)/python $(SEG)/export.py out/segmentation/more/cutout.pt
	$(BIN)/python $(SEG)/cutout.py out/segmentation/drawn=0.1 --more --steps 1900 --jobs 1 -o out/segmentation/real
	$(BIN)/python $(SEG)/export.py out/segmentation/real/cutout.pt
	$(BIN)/python $(SEG)/names.py -o out/segmentation/names
	$(BIN)/python $(SEG)/train_detector.py -o out/segmentation/detector
	$(BIN)/python $(SEG)/mix_weights.py out/segmentation/detector/detector.pt
	$(BIN)/python $(SEG)/export.py out/segmentation/detector/detector-mixed.pt
	$(BIN)/python $(SEG)/judge_examples.py -o out/segmentation/judge --jobs 2
	$(BIN)/python $(SEG)/judge.py out/segmentation/judge

.venv/.python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "physgen needs Python 3.11 or newer: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	@touch $@

.venv/.demo: .venv/.python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable ".[edit,fit]"
	@touch $@

# torch first and by itself. PyPI's for Linux brings CUDA along, some GB: without a GPU,
# make test TORCH="torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu" takes 190 MB
.venv/.test: .venv/.python pyproject.toml
	$(BIN)/python -m pip install --quiet $(TORCH)
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	@touch $@ .venv/.demo

.venv/.docs: .venv/.python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable '.[docs,edit,fit]'
	@touch $@ .venv/.demo

.venv/.studio: .venv/.python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable '.[studio]'
	@touch $@

clean:
	rm -rf .venv out dist build
