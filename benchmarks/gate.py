"""Records what physgen computes, and compares two records: the check that a change of structure keeps the results.

    python benchmarks/gate.py record OUT.json [--physgen DIR] [--quick]
    python benchmarks/gate.py compare BEFORE.json AFTER.json

`record` works through the command line alone, so that it runs on any version. `--physgen DIR` names the checkout
whose code, scenes and refused files are used; it is this one by default. PHYSGEN_PEER_SCENES may name a folder of
further scenes (one folder each, as `physgen import physgen` reads them). What is recorded:

    scenes      every scene: what it resolves to, samples of the trajectory, frames spread over its duration, and the
                names of the output files
    perceive    every bundled photo and the peers: scene file without its comments, and the maps
    export      two scenes, in all formats
    commands    further ways through render, simulate, sweep and verify; the flags of every command
    measures    quick runs of `evaluate --json`, times left out
    refused     messages and exit code of every file in tests/refused/cases

`--quick` leaves out perceive and export of the bundled photos and draws fewer frames: about two minutes on two
processors. A whole record takes about six.

`compare` prints every difference, by group, and ends with 1 where one is neither a reworded message (same places,
same exit code) nor listed in INTENDED. Messages that were only reworded are listed apart.
"""

from __future__ import annotations

import argparse
import csv
import difflib
import fnmatch
import hashlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

HERE = Path(__file__).resolve().parent.parent
JOBS = 2
TIMEOUT = 900  # s: of one command; it only ends a command that hangs
MAX_TEXT = 200_000  # characters: longer texts are recorded as a hash

INTENDED: dict[str, str] = {
    "commands/fan/*fan.csv": "draws are the standard library's and NumPy's, which differ in the last digit",
    "commands/fan/*verdict": "sentences in plainer words",
    "commands/fan/*/fan/*": "no light is drawn; outcomes are fate and place alone, without a cause",
    "*/physics.json/units/*": "descriptions of units are in plainer words",
    "commands/schema*": "descriptions of keys are in plainer words",
    "*/scene-1.schema.json/*/description": "descriptions of keys are in plainer words",
    "*/caption*": "captions are gone",
    "*/prompt*": "prompts are labels",
    "*/events/events.csv": "events.json has the same",
    "*/events.csv": "events.json has the same",
    "*/conditioning*": "the format is gone",
    "export/*/files": "events.csv, wheel and conditioning are gone",
    "*/export/files": "events.csv, wheel and conditioning are gone",
    "*/wheel/*": "the format is gone",
    "*/events.json/events/*/text": "as captions",
    "*/events.json/sentences*": "as captions",
    "*/manifest.json/inputs/scene.yaml": "comments of bundled scenes are in plainer words",
    "*/events.json/sentences": "as captions",
    "scenes/kitchen/*/inputs/scene.yaml": "a comment of the scene is reworded",
    "scenes/ramp/*/inputs/scene.yaml": "a comment of the scene is reworded",
    "measures/physics*": "closed forms are a benchmark; tests/benchmarks holds them",
    "commands/perceive --help*": "--fallback and --keep-models are gone",
    "commands/gallery --help*": "--single-file went",
    "measures/segmentation*": "one scope; no labels, means over photos, curves at other IoUs",
    "commands/backends --help*": "--fallback is gone",
    "perceive/*/background.png*": "the exemplar fill has no costs by direction and one strength of grain",
    "perceive/*/normals.png*": "hidden balls by the circle fit that all of perception shares",
    "perceive/*/albedo.png*": "as normals",
    "perceive/*/shading.png*": "as normals",
    "perceive/import-*/clip/*": "as imported scenes",
    "perceive/import-*/trajectory/*": "as imported scenes",
    "perceive/import-*/resolved": "as imported scenes",
    "perceive/import-*/export/*": "as imported scenes",
    "commands/fan/*": "as perceived scenes",
    "perceive/*/perceived.json": "the values that perception wrote, so that a refresh knows the user's",
    "perceive/*/files": "perceived.json is always written",
    "perceive/*/clean.png*": "as background.png",
    "perceive/*/shadows.png*": "as background.png",
    "perceive/import-*/import/*": "as background.png",
    "perceive/*/scene.yaml": "masses of solids of revolution and the light from their normals move by 1 %",
    "perceive/*/messages": "warnings on shapes and background have gone",
    "commands/dataset --help*": "--link and --shard-size are gone",
    "commands/edit --help*": "--fallback is gone",
    "commands/render --help*": "--ship is gone",
    "commands/sweep --help*": "--ship is gone",
    "commands/sweep/files": "strips of frames are gone",
    "*/manifest.json/chaos": "--chaos went: two runs with --set, or --fan",
    "*/manifest.json/device": "--device went: the processor draws all frames",
    "*/manifest keys": "as above",
    "commands/evaluate fid --help*": "one flow; --features is --inception; --fit, --full-colour, --only went",
    "commands/evaluate study --help*": "--photos and --title went",
    "commands/export --help*": "--size, --fps, --frames are --set render.KEY; --device went",
    "commands/simulate --help*": "--chaos went",
    "commands/verify --help*": "--device went",
    "commands/simulate/*": "of wall-ball, whose story was edited",
    "commands/variants/clip/*": "shadows end where their floor ends",
    "commands/verify/video.gif": "shadows end where their floor ends",
    "export/cans/messages": "export does not report how long the frames play",
}
"""Patterns of entries (`group/name/item`, as fnmatch reads them) that may differ, with the reason."""
STORIES = (
    "bottle-book",
    "cans",
    "dominoes",
    "kitchen",
    "pyramid",
    "ramp",
    "seesaw",
    "shelf",
    "wall-ball",
)
SHADED = ("cups", "curling", "marbles", "pendulum", "toy-car")
INTENDED |= {
    f"scenes/{name}/*": "its story was edited: pushes, duration, pace"
    for name in STORIES
}
INTENDED |= {
    f"scenes/{name}/clip/*": "shadows end where their floor ends" for name in SHADED
}

VARIABLE_KEYS = re.compile(
    r"(^|_)(cpu|wall|elapsed|started|finished|date|date_created|memory|host|machine|platform|python|versions?|"
    r"processors?|cores|commit|took|mark|report\.html)($|_)"
)
"""Keys of JSON whose values differ from run to run."""

Values = dict[str, Any]

FORMATS = "frames,flo,coco,davis,events,trajectory,physics"
MAP_FORMATS = "depth,normals"
COMMANDS = (
    *(
        "perceive",
        "import",
        "edit",
        "check",
        "simulate",
        "render",
        "sweep",
        "export",
        "dataset",
    ),
    *("gallery", "verify", "backends", "schema", "evaluate"),
)
MEASURES = ("physics", "segmentation", "fid", "study")


class Runner:
    """Runs commands of one checkout in a scratch folder that holds copies of its inputs."""

    def __init__(self, checkout: Path, folder: Path) -> None:
        self.checkout, self.folder = checkout, folder
        root = checkout / "physgen" / "__main__.py"
        self.module = "physgen" if root.exists() else "physgen.cli"
        self.environment = os.environ | {
            "PYTHONPATH": str(checkout),
            "XDG_CACHE_HOME": str(folder / "cache"),
            "OPENBLAS_NUM_THREADS": "1",
            "COLUMNS": "100",
        }
        shutil.copytree(checkout / "scenes", folder / "scenes")
        shutil.copytree(checkout / "tests" / "refused" / "cases", folder / "cases")
        peers = os.environ.get("PHYSGEN_PEER_SCENES")
        if (checkout / "benchmarks").is_dir():
            (folder / "benchmarks").symlink_to(checkout / "benchmarks")
        if (truth := checkout / "studio" / "truth").is_dir():
            (folder / "truth").symlink_to(truth)
        self.peers = (
            sorted(path.parent.name for path in Path(peers).glob("*/sim.yaml"))
            if peers
            else []
        )
        for name in self.peers:
            shutil.copytree(Path(peers or "", name), folder / "peers" / name)

    def run(self, *arguments: str, cwd: str = ".") -> subprocess.CompletedProcess[str]:
        """One command, to its end."""
        return subprocess.run(
            [sys.executable, "-m", self.module, *arguments],
            cwd=self.folder / cwd,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )

    def made(self, name: str) -> Path:
        """A path in the folder of results."""
        path = self.folder / "made" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def digest(data: bytes) -> str:
    """A short hash."""
    return hashlib.sha256(data).hexdigest()[:16]


def array_value(array: np.ndarray) -> Values:
    """Hash and summary of an array."""
    value: Values = {"shape": list(array.shape), "dtype": str(array.dtype)}
    if array.dtype.kind in "OUS":
        return value | {"values": array.astype(str).ravel()[:200].tolist()}
    value["hash"] = digest(np.ascontiguousarray(array).tobytes())
    if array.size:
        number = array.astype(np.float64)
        value |= {
            "min": float(number.min()),
            "max": float(number.max()),
            "mean": float(number.mean()),
        }
    return value


def file_value(path: Path) -> Any:
    """What a file holds, so that a difference can be read."""
    if path.suffix in (".png", ".gif", ".webp", ".jpg"):
        with Image.open(path) as image:
            return array_value(np.asarray(image))
    if path.suffix in (".npz",):
        with np.load(path, allow_pickle=False) as arrays:
            return {key: array_value(arrays[key]) for key in arrays}
    if path.suffix == ".npy":
        return array_value(np.load(path))
    data = path.read_bytes()
    if path.suffix == ".json":
        return steady(json.loads(data))
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return {"bytes": len(data), "hash": digest(data)}
    if path.suffix in (".yaml", ".yml"):
        text = without_comments(text)
    return text_value(text)


def text_value(text: str) -> Any:
    """The text itself, or a hash where it is long."""
    return (
        text
        if len(text) <= MAX_TEXT
        else {"characters": len(text), "hash": digest(text.encode())}
    )


def without_comments(text: str) -> str:
    """YAML without its comments and empty lines."""
    lines = (
        re.sub(r"(^|\s)#(?=\s|$|\S).*$", "", line).rstrip()
        for line in text.splitlines()
    )
    return "\n".join(line for line in lines if line)


def steady(value: Any) -> Any:
    """Plain data without the keys that differ from run to run."""
    if isinstance(value, dict):
        return {
            key: steady(child)
            for key, child in value.items()
            if not VARIABLE_KEYS.search(str(key))
        }
    if isinstance(value, list):
        return [steady(child) for child in value]
    return value


def key_paths(value: Any, path: str = "") -> Iterator[str]:
    """The keys of plain data, as dotted paths; lists count as one item."""
    if isinstance(value, dict):
        for key, child in value.items():
            yield f"{path}{key}"
            yield from key_paths(child, f"{path}{key}.")
    elif isinstance(value, list):
        for child in value[:1]:
            yield from key_paths(child, f"{path}[].")


def listing(folder: Path) -> list[str]:
    """Names of the files under a folder."""
    return sorted(
        str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()
    )


def folder_values(folder: Path, skip: tuple[str, ...] = ()) -> Values:
    """What every file under a folder holds, apart from names that match `skip`."""
    values: Values = {"files": listing(folder)}
    for name in values["files"]:
        if not any(fnmatch.fnmatch(name, pattern) for pattern in skip):
            values[name] = file_value(folder / name)
    return values


def outcome(done: subprocess.CompletedProcess[str]) -> Values:
    """Exit code and messages of a command."""
    return {"exit": done.returncode, "messages": done.stderr.splitlines()}


RENDER_SKIP = ("*.html", "*.mp4", "manifest.json", "*.js", "*.css", "*.gif", "*.webp")
"""Files whose bytes hold times or versions; their presence is recorded."""


def scene_values(
    runner: Runner, scene: str, frames: int, flags: tuple[str, ...] = ()
) -> Values:
    """What becomes of one scene."""
    name = scene.replace("/", "-").removesuffix(".yaml") + "".join(flags).replace(
        "/", "-"
    )
    values: Values = {"check": outcome(runner.run("check", scene))}
    output = runner.made(f"trajectory/{name}.npz")
    values["simulate"] = outcome(
        runner.run("simulate", scene, "-o", str(output), *flags)
    )
    if output.exists():
        values["trajectory"] = file_value(output)
    if frames:
        clips = runner.made(f"clips/{name}")
        done = runner.run(
            *(
                "render",
                scene,
                "-o",
                str(clips),
                "--format",
                "png",
                "--report",
                "none",
                "--no-cache",
            ),
            *("--set", f"render.frames={frames}", *flags),
        )
        values["render"] = outcome(done)
        values["clip"] = folder_values(clips, RENDER_SKIP)
        for manifest in clips.rglob("manifest.json"):
            values["resolved"] = json.loads(manifest.read_text())["document"]
            values["manifest keys"] = sorted(
                set(key_paths(json.loads(manifest.read_text())))
            )
    return values


def perceived_values(runner: Runner, name: str, *arguments: str) -> Values:
    """What perceive or import makes of a photo."""
    scene = runner.made(f"perceived/{name}/scene.yaml")
    done = runner.run(*arguments, "-o", str(scene))
    return outcome(done) | folder_values(scene.parent, ("*/scene-1.schema.json",))


def export_values(runner: Runner, name: str, scene: str, formats: str) -> Values:
    """All formats of ground truth of a scene."""
    folder = runner.made(f"exports/{name}")
    done = runner.run(
        *(
            "export",
            scene,
            "--format",
            formats,
            "--set",
            "render.frames=5",
            "-o",
            str(folder),
            "--no-cache",
        )
    )
    return outcome(done) | folder_values(folder, ("*manifest.json",))


def json_values(runner: Runner, *arguments: str) -> Values:
    """What a command prints as JSON."""
    done = runner.run(*arguments)
    values = outcome(done)
    try:
        values["json"] = steady(json.loads(done.stdout))
    except json.JSONDecodeError:
        values["output"] = text_value(done.stdout)
    return values


def flag_values(runner: Runner, *command: str) -> Values:
    """Flags and exit code of a command's help."""
    done = runner.run(*command, "--help")
    usage = done.stdout.partition("\n\n")[0]
    return {
        "exit": done.returncode,
        "flags": sorted(set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", usage))),
    }


def refused_values(runner: Runner, case: str) -> Values:
    """Messages about a wrong file, by the flags of each command in its first lines."""
    lines = (runner.folder / "cases" / case).read_text(encoding="utf-8").splitlines()
    mark = "# flags: "
    commands = [line.removeprefix(mark) for line in lines if line.startswith(mark)]
    values = {}
    for flags in commands or [""]:
        done = runner.run("check", case, *flags.split(), cwd="cases")
        result = outcome(done) | {"output": done.stdout.splitlines()}
        values |= {f"{key} {flags}".strip(): value for key, value in result.items()}
    return values


def sweep_values(runner: Runner) -> Values:
    """A sweep of a small scene: its table and clips."""
    folder = runner.made("sweep")
    scene = "scenes/physics/01-free-fall.yaml"
    done = runner.run(*("sweep", scene, "objects.*.mass=100,200", "-o", str(folder)))
    values = outcome(done) | {"files": listing(folder)}
    for table in folder.glob("*.csv"):
        rows = list(csv.DictReader(io.StringIO(table.read_text())))
        values[table.name] = [steady(row) for row in rows]
    return values


def verify_values(runner: Runner) -> Values:
    """A clip verified, and its video."""
    clips, scene = runner.made("verified"), "scenes/pendulum/scene.yaml"
    made = runner.run(
        "render",
        scene,
        "-o",
        str(clips),
        "--format",
        "mp4,gif,webp",
        "--set",
        "render.frames=4",
    )
    values: Values = {"render": outcome(made), "files": listing(clips)}
    for still in (*clips.rglob("*.gif"), *clips.rglob("*.webp")):
        values[still.name] = file_value(still)
    for clip in sorted(path.parent for path in clips.rglob("manifest.json")):
        done = runner.run("verify", str(clip))
        values["verify"] = {"exit": done.returncode}
    return values


def tasks(runner: Runner, quick: bool) -> Iterator[tuple[str, Callable[[], Values]]]:
    """Everything that is recorded, as names and functions; the slowest come first."""
    folder = runner.folder
    photos = sorted(path.parent.name for path in folder.glob("scenes/*/photo.png"))
    tests = sorted(
        str(path.relative_to(folder)) for path in folder.glob("scenes/physics/*.yaml")
    )
    for name in runner.peers:
        yield f"perceive/import-{name}", lambda n=name: perceived_peer(runner, n, quick)
    if not quick:
        for name in photos:
            photo = f"scenes/{name}/photo.png"
            yield (
                f"perceive/{name}",
                lambda n=name, p=photo: perceived_values(runner, n, "perceive", p),
            )
        for name in ("shelf", "curling"):
            given = (
                "perceive",
                f"scenes/{name}/photo.png",
                "--masks",
                f"scenes/{name}/photo.assets/masks.png",
            )
            yield (
                f"perceive/{name}-masks",
                lambda n=name, g=given: perceived_values(runner, f"{n}-masks", *g),
            )
        asked = (
            "--box",
            "60,60,200,200",
            "--point",
            "300,300",
            "--label",
            "block-1=wooden block",
        )
        yield (
            "perceive/kitchen-asked",
            lambda: perceived_values(
                runner, "asked", "perceive", "scenes/kitchen/photo.png", *asked
            ),
        )
        yield (
            "export/cans",
            lambda: export_values(runner, "cans", "scenes/cans/scene.yaml", FORMATS),
        )
    for name in photos:
        scene, frames = f"scenes/{name}/scene.yaml", 4 if quick else 12
        yield f"scenes/{name}", lambda s=scene, f=frames: scene_values(runner, s, f)
    for scene in tests:
        yield (
            f"scenes/{Path(scene).stem}",
            lambda s=scene: scene_values(runner, s, 0 if quick else 3),
        )
    cans = "scenes/cans/scene.yaml"
    yield (
        "commands/variants",
        lambda: scene_values(
            runner, "scenes/billiards/scene.yaml", 2, ("--variant", "no-nine")
        ),
    )
    yield "commands/simulate", lambda: json_values(runner, "simulate", cans, "--json")
    yield "commands/fan", lambda: fan_values(runner)
    yield "commands/sweep", lambda: sweep_values(runner)
    yield "commands/verify", lambda: verify_values(runner)
    yield "commands/schema", lambda: json_values(runner, "schema")
    for command in COMMANDS:
        yield f"commands/{command} --help", lambda c=command: flag_values(runner, c)
    for measure in MEASURES:
        yield (
            f"commands/evaluate {measure} --help",
            lambda m=measure: flag_values(runner, "evaluate", m),
        )
    forms = (
        runner.checkout / "benchmarks" / "physics"
    )  # where closed forms are part of the package, there is none
    rows = (
        *([str(forms)] if forms.is_dir() else []),
        *("--draws", "1", "--no-convergence", "--jobs", "1", "--json"),
    )
    yield "measures/physics", lambda: json_values(runner, "evaluate", "physics", *rows)
    if not quick:
        yield "measures/segmentation", lambda: segmentation_values(runner)
    for case in sorted(path.name for path in folder.glob("cases/*.yaml")):
        yield f"refused/{case}", lambda c=case: refused_values(runner, c)


def fan_values(runner: Runner) -> Values:
    """Draws of what the photo leaves open, of a perceived scene."""
    scene = runner.made("fan-scene/scene.yaml")
    values = outcome(runner.run("perceive", "scenes/shelf/photo.png", "-o", str(scene)))
    done = runner.run(
        *(
            "render",
            str(scene),
            "-o",
            str(runner.made("fan")),
            "--fan",
            "4",
            "--preview",
            "--format",
            "png",
        )
    )
    return (
        values
        | {"render": outcome(done)}
        | folder_values(runner.made("fan"), RENDER_SKIP)
    )


def perceived_peer(runner: Runner, name: str, quick: bool) -> Values:
    """A peer scene imported, drawn and exported; its photo perceived."""
    values: Values = {
        "import": perceived_values(
            runner, f"peer-{name}", "import", "physgen", "--faithful", f"peers/{name}"
        )
    }
    scene = str(
        runner.made(f"perceived/peer-{name}/scene.yaml").relative_to(runner.folder)
    )
    values |= scene_values(runner, scene, 4 if quick else 12)
    if name == runner.peers[-1]:
        values["export"] = export_values(
            runner, name, scene, f"{FORMATS},{MAP_FORMATS}"
        )
    if not quick:
        photo = f"peers/{name}/original.png"
        values["perceive"] = perceived_values(
            runner, f"photo-{name}", "perceive", photo
        )
    return values


def segmentation_values(runner: Runner) -> Values:
    """Objects found in two photos against their masks."""
    for name in ("shelf", "curling"):
        target = runner.made(f"labelled/{name}/photo.png").parent
        for file in ("photo.png", "photo.assets/masks.png"):
            shutil.copy(runner.folder / "scenes" / name / file, target)
    return json_values(
        runner, "evaluate", "segmentation", str(runner.made("labelled")), "--json"
    )


def record(output: Path, checkout: Path, quick: bool) -> None:
    """Write the record of a checkout."""
    with tempfile.TemporaryDirectory() as scratch:
        runner = Runner(checkout.resolve(), Path(scratch))
        work = list(tasks(runner, quick))
        with ThreadPoolExecutor(JOBS) as pool:
            made = pool.map(lambda task: relative(task[1](), scratch), work)
            values = {}
            for count, ((name, _), value) in enumerate(zip(work, made, strict=True), 1):
                values[name] = value
                print(
                    f"\r{count} of {len(work)}: {name:<60}",
                    end="",
                    file=sys.stderr,
                    flush=True,
                )
    print(file=sys.stderr)
    output.write_text(
        json.dumps(values, indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    )


def relative(value: Any, scratch: str) -> Any:
    """Plain data without the name of the scratch folder."""
    text = (
        json.dumps(value, ensure_ascii=False)
        .replace(scratch + "/", "")
        .replace(scratch, ".")
    )
    return json.loads(text)


def compare(before: Values, after: Values) -> int:
    """Print the differences; how many are neither reworded nor intended."""
    reworded: list[str] = []
    intended: dict[str, list[str]] = defaultdict(list)
    found: dict[str, list[str]] = defaultdict(list)
    for name in sorted(before.keys() | after.keys()):
        for path, old, new in differences(
            before.get(name, MISSING), after.get(name, MISSING), name
        ):
            line = f"{path}\n    before: {shown(old)}\n    after:  {shown(new)}"
            reason = next(
                (why for glob, why in INTENDED.items() if fnmatch.fnmatch(path, glob)),
                None,
            )
            if reason:
                intended[reason].append(path)
            elif is_reworded(path, old, new):
                reworded.append(line)
            else:
                found[name.partition("/")[0]].append(line)
    notes = [
        f"{reason}: {len(paths)}, e.g. {paths[0]}" for reason, paths in intended.items()
    ]
    for title, lines in (("reworded", reworded), ("intended", notes), *found.items()):
        if lines:
            print(f"== {title}: {len(lines)}", *lines, sep="\n")
    count = sum(map(len, found.values()))
    allowed = sum(map(len, intended.values()))
    print(
        f"{len(after)} entries; {count} differences, {allowed} intended, {len(reworded)} reworded"
    )
    return count


MISSING = "(missing)"
PLACE = re.compile(r"^([^\s:]+(:\d+){0,2}):")


def is_reworded(path: str, old: Any, new: Any) -> bool:
    """Whether messages speak of the same places, in other words; or a sentence within JSON is another."""
    if isinstance(old, str) and isinstance(new, str) and "/json/" in path:
        return min(old.count(" "), new.count(" ")) >= 2
    if (
        not path.endswith(("/messages", "/output"))
        or not isinstance(old, list)
        or not isinstance(new, list)
    ):
        return False
    return len(old) == len(new) and places(old) == places(new)


def places(messages: list[str]) -> list[str]:
    """File, line and column of each message."""
    found = (PLACE.match(message) for message in messages)
    return sorted(match[1] if match else "" for match in found)


def differences(old: Any, new: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Paths at which two values differ, with both; of lists of names what only one has."""
    if old == new:
        return
    if isinstance(old, dict) and isinstance(new, dict) and "hash" not in old:
        for key in sorted(old.keys() | new.keys()):
            if ".json" in path and VARIABLE_KEYS.search(key):
                continue
            yield from differences(
                old.get(key, MISSING), new.get(key, MISSING), f"{path}/{key}"
            )
    elif (
        path.endswith(("/files", "/manifest keys", "/flags"))
        and isinstance(old, list)
        and isinstance(new, list)
    ):
        yield path, sorted(set(old) - set(new)), sorted(set(new) - set(old))
    elif (
        isinstance(old, list)
        and isinstance(new, list)
        and len(old) == len(new)
        and ("/json/" in path or ".json/" in path)
    ):
        for number, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from differences(one, other, f"{path}/{number}")
    elif isinstance(old, str) and isinstance(new, str) and "\n" in old:
        yield path, *text_difference(old, new)
    else:
        yield path, old, new


def text_difference(old: str, new: str) -> tuple[list[str], list[str]]:
    """Lines that only one of two texts has."""
    lines = list(difflib.ndiff(old.splitlines(), new.splitlines()))
    return [line[2:] for line in lines if line[0] == "-"], [
        line[2:] for line in lines if line[0] == "+"
    ]


def shown(value: Any) -> str:
    """A value, shortened."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 700 else f"{text[:700]}..."


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("output", type=Path)
    recording.add_argument("--physgen", type=Path, default=HERE)
    recording.add_argument("--quick", action="store_true")
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    arguments = parser.parse_args()
    if arguments.command == "record":
        record(arguments.output, arguments.physgen, arguments.quick)
        return 0
    records = [
        json.loads(path.read_text()) for path in (arguments.before, arguments.after)
    ]
    return 1 if compare(*records) else 0


if __name__ == "__main__":
    sys.exit(main())
