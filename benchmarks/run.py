"""Measures speed, memory and quality; writes benchmarks/results/*.json, and the pages in docs/ from them.

    python benchmarks/run.py                 # everything; peer scenes only where PHYSGEN_PEER_SCENES names their folder
    python benchmarks/run.py render start    # some of it
    python benchmarks/run.py physics         # the physics scorecard, its page and the scenes of its first draws
    python benchmarks/run.py rivals          # the same rows in other engines, beside ours; some minutes
    python benchmarks/run.py ghosts          # edges left where objects and their shadows were
    python benchmarks/run.py fills           # background fills of holes in real photos; PHYSGEN_LABELLED_PHOTOS
    python benchmarks/run.py fidelity        # frames against the studio's truth videos
    python benchmarks/run.py gallery         # pages of 1,000 and 5,000 clips in headless Chromium
    python benchmarks/run.py batch           # many clips: throughput, what each costs beside its stages, memory
    python benchmarks/run.py cluster         # 10,000 tiny previews on a Dask cluster of this machine
    python benchmarks/run.py kills           # a batch killed 50 times against one that never was
    python benchmarks/run.py attack          # hostile inputs of three seeds; an hour
    python benchmarks/run.py growth          # cost of 10 to 1,000 bodies, and its plot
    python benchmarks/run.py labels          # ground truth: every format in one pass, beside its encoders
    python benchmarks/run.py fid             # the paper's ablation of physical reasoning; some 15 minutes
    python benchmarks/run.py refine          # what refinement keeps exactly, and costs, on tiny models; see refine.py
    python benchmarks/run.py editor          # physgen edit: how soon an edit shows its motion
    python benchmarks/run.py plausibility    # right clips told from wrong ones, and our scenes
    python benchmarks/run.py properties controllability runtime    # the paper's measures of that name
    python benchmarks/run.py objects         # what perceive writes under objects:, on real photos and drawings
    python benchmarks/run.py views           # the view of photos that were labelled by hand
    python benchmarks/run.py sound           # the sound of contacts: closed forms and cost
    python benchmarks/run.py sureness        # stated confidences of masses beside their errors
    python benchmarks/run.py strangers       # clips of photos of strangers; PHYSGEN_MATERIAL
    python benchmarks/run.py motions         # how many photos of COCO move; PHYSGEN_MATERIAL

Times are CPU seconds of one run each on whatever machine this is: compare within a table, not between machines.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from ablations import ablations
from attack import attacks
from batch import batch
from cluster_previews import cluster
from colour_steps import measure_steps
from editor import editor
from fid import fid
from fills import bench as background_fills
from first_motions import first_motions
from frames import frames as frame_rows
from gallery import gallery
from ghosts import ghosts
from growth import growth, plot
from kills import kills
from labels import labels
from objects import objects
from paper import controllability, properties, runtime
from perceiving import first_clips, perceiving, stage_costs
from percepts import percepts
from physics.run import physics, rivals
from plausibility.run import plausibility
from prompts import prompts
from refine import refining
from segments import names, segmentation
from sound import sound
from strangers import strangers
from sureness import sureness
from tables import RESULTS, write
from views import views

from physgen import pipeline
from physgen.cli.main import main as physgen
from physgen.evaluate import fidelity
from physgen.perceive.perceive import KnownFacts, perceive
from physgen.perceive.roles import BoundaryGuess
from physgen.perceive.segment.prompts import from_masks
from physgen.photometry import decode, luminance

ROOT = Path(__file__).resolve().parent.parent
BUNDLED = ("billiards", "dominoes")
PEERS = ("pool", "domino", "pig_ball")
FRAMES = (16, 300)


def peer_folder() -> Path | None:
    name = os.environ.get("PHYSGEN_PEER_SCENES")
    return Path(name) if name else None


def scenes(folder: Path) -> dict[str, Path]:
    """Bundled scenes as shipped, peer scenes imported into `folder`."""
    found = {name: ROOT / "scenes" / name / "scene.yaml" for name in BUNDLED}
    if peers := peer_folder():
        for name in PEERS:
            found[name] = folder / f"{name}.yaml"
            assert (
                physgen(
                    [
                        "import",
                        "physgen",
                        "--faithful",
                        str(peers / name),
                        "-o",
                        str(found[name]),
                    ]
                )
                == 0
            )
    return found


def render(folder: Path) -> list[dict]:
    """Seconds a stage and peak memory, each clip in a process of its own, at few and at many frames."""
    rows = []
    for name, path in scenes(folder).items():
        for frames in FRAMES:
            out = folder / "out" / str(frames)
            command = [
                sys.executable,
                "-m",
                "physgen",
                "render",
                str(path),
                "-o",
                str(out),
            ]
            subprocess.run(
                [*command, "--set", f"render.frames={frames}"],
                check=True,
                capture_output=True,
            )
            run = out / (path.parent.name if path.name == "scene.yaml" else path.stem)
            manifest = json.loads((run / "manifest.json").read_text())
            timing = json.loads((run / "timing.json").read_text())
            rows.append(
                {
                    "scene": name,
                    "objects": len(manifest["document"]["objects"]),
                    "frames": len(manifest["frames"]),
                    "cpu": {
                        stage: times["cpu"] for stage, times in timing["stages"].items()
                    },
                    "wall": round(
                        sum(times["wall"] for times in timing["stages"].values()), 3
                    ),
                    "peak_mib": timing["peak_memory_mib"],
                    "video_kib": round((run / "video.mp4").stat().st_size / 1024),
                }
            )
    return rows


def cpu_of(*command: str, repeat: int = 5) -> float:
    """Median CPU seconds of a process."""
    times = []
    for _ in range(repeat):
        before = os.times()
        subprocess.run(command, check=True, capture_output=True)
        after = os.times()
        times.append(
            after.children_user
            + after.children_system
            - before.children_user
            - before.children_system
        )
    return round(float(np.median(times)), 3)


def start(folder: Path) -> list[dict]:
    """What starting costs."""
    ball = folder / "ball.yaml"
    ball.write_text(
        "physgen: 1\nsize: [64, 48]\nobjects: {a: {shape: {circle: {center: [30, 20], radius: 8}}}}\n"
    )
    python = sys.executable
    rows = [
        ("python -c pass", cpu_of(python, "-c", "pass")),
        ("physgen --help", cpu_of(python, "-m", "physgen", "--help")),
        (
            "physgen check, one ball",
            cpu_of(python, "-m", "physgen", "check", str(ball)),
        ),
        (
            "physgen simulate, one ball, 2 s",
            cpu_of(python, "-m", "physgen", "simulate", str(ball)),
        ),
    ]
    return [{"command": command, "cpu": cpu} for command, cpu in rows]


def frames_against_truth(folder: Path) -> list[dict]:
    """Frames against the studio's truth videos, ours and the paper's way, each scene and way."""
    return fidelity.evaluate(ROOT / "studio/truth", ways=ablations)["rows"]


def shadows(folder: Path) -> list[dict]:
    """How much of the photos' shadows is lifted, given the true masks: errors of the logarithm of light, rms."""
    rows = []
    for path in sorted((ROOT / "studio/truth").glob("*/truth.json")):
        scene = pipeline.load(ROOT / "scenes" / path.parent.name / "scene.yaml")
        maps = pipeline.percepts(scene)
        assert maps is not None
        view = BoundaryGuess(scene.world.view, 1.0, "as given", ())
        found = perceive(
            maps.rgb, from_masks(maps.labels), facts=KnownFacts(view)
        ).percepts
        open_ = (
            cv2.dilate(
                ((maps.coverage > 0) | (found.coverage > 0)).astype(np.uint8),
                np.ones((5, 5)),
            )
            == 0
        )
        true = _log(maps.clean) - _log(maps.background)
        # Contact strips are filled in both backgrounds of `perceive`: compare its clean
        # picture with the photo's light and with the truth.
        clean = _log(found.background if found.clean is None else found.clean)
        dark, plain = open_ & (true > 0.05), open_ & (np.abs(true) < 0.03)
        errors = {
            "before": true[dark],
            "after": (_log(maps.clean) - clean)[dark],
            "elsewhere": (clean - _log(maps.background))[plain],
        }
        row = {"scene": path.parent.name, "lifted": found.clean is not None}
        rows.append(
            row
            | {
                key: round(float(np.sqrt((e**2).mean())), 3)
                for key, e in errors.items()
            }
        )
    return rows


def _log(srgb: np.ndarray) -> np.ndarray:
    return np.log(luminance(decode(srgb)) + 2e-3)


def traces(folder: Path) -> list[dict]:
    """What is left where objects stood: edges in last frames, steps of colour."""
    return ghosts(folder) + measure_steps()


def frame_costs(folder: Path) -> list[dict]:
    """What a frame costs, in scenes drawn by formula and in those of `render`."""
    return frame_rows(
        scenes(folder), sorted((ROOT / "scenes").glob("*/scene.yaml")), folder
    )


PARTS = {
    "render": render,
    "start": start,
    "segmentation": segmentation,
    "objects": objects,
    "names": names,
    "physics": physics,
}
PARTS |= {
    "rivals": rivals,
    "growth": growth,
    "fidelity": frames_against_truth,
    "shadows": shadows,
    "ghosts": traces,
    "fills": background_fills,
}
PARTS |= {"frames": frame_costs}
PARTS |= {
    "prompts": prompts,
    "perceive": perceiving,
    "stages": stage_costs,
    "first": first_clips,
    "percepts": percepts,
}
PARTS |= {
    "refine": refining,
    "gallery": gallery,
    "batch": batch,
    "cluster": cluster,
    "kills": kills,
    "attack": attacks,
    "labels": labels,
    "plausibility": plausibility,
    "fid": fid,
    "editor": editor,
    "sureness": sureness,
    "sound": sound,
    "views": views,
    "strangers": strangers,
    "motions": first_motions,
}
PARTS |= {
    "properties": properties,
    "controllability": controllability,
    "runtime": runtime,
}


def main(names: list[str]) -> None:
    RESULTS.mkdir(exist_ok=True)
    for name in names or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            rows = PARTS[name](Path(folder))
        machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
        result = {"machine": machine, "rows": rows}
        file = "physics" if name == "rivals" else name
        (RESULTS / f"{file}.json").write_text(json.dumps(result, indent=1) + "\n")
    grown = json.loads((RESULTS / "growth.json").read_text())["rows"]
    (ROOT / "docs" / "growth.svg").write_text(plot(grown))
    write()


if __name__ == "__main__":
    main(sys.argv[1:])
