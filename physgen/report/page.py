"""Scene, world and run record -> report.html. Everything from outside is escaped."""

from __future__ import annotations

import base64
import shlex
from math import degrees
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.pairs import pair_table
from physgen.compile.world import Body, World
from physgen.report.holds import drawn, listed
from physgen.report.record import RunRecord, versions
from physgen.resources import resource
from physgen.scene.model import Load, Play, Render, Scene, View

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

LONGEST_ARROW = 0.14
"""Of the canvas's diagonal."""


def report_page(
    scene: Scene, world: World, record: RunRecord, first: U8, video: str | None, scene_text: str
) -> str:
    """The HTML page. `first` is frame 0 `(H, W, 3)` sRGB, shown with outlines, boundaries and forces drawn on it."""
    width, height = scene.size
    longest = max((stage.wall for stage in record.stages.values()), default=1.0) or 1.0
    page: str = _template("report.html.j2").render(
        title=scene.name,
        size=(width, height),
        video_size=scene.video_size,
        frames=len(record.frames),
        fps=scene.render.fps,
        duration=world.duration,
        video=video,
        photo=_data_uri(first),
        view_box=f"-0.5 -0.5 {width} {height}",
        walls=_walls(scene, world),
        objects=[_object(scene, k, body) for k, body in enumerate(world.bodies)],
        arrows=_arrows(world),
        held=drawn(scene, world),
        holds=listed(scene),
        warnings=[str(warning["text"]) for warning in record.warnings],
        world=_world_facts(scene, world),
        engine=_engine(record),
        chaos=_chaos(record),
        combine=world.combine.value,
        pairs=pair_table(world),
        stages=[
            {
                "name": name,
                "wall": f"{t.wall:.3f}",
                "cpu": f"{t.cpu:.3f}",
                "share": round(100 * t.wall / longest, 1),
            }
            for name, t in record.stages.items()
            if name != "report"  # this page, not yet done
        ],
        command=shlex.join(record.command),
        scene_text=scene_text,
        versions=versions(),
        inputs=record.inputs,
    )
    return page


def _template(name: str) -> Any:
    import jinja2

    loader = jinja2.FileSystemLoader(resource("templates", name).parent)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.get_template(name)


def _data_uri(rgb: U8) -> str:
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(rgb[:, :, ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 90])
    if not done:
        raise ValueError("the photo could not be written as JPEG")
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def _points(points: Array) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in points)


def _walls(scene: Scene, world: World) -> list[dict[str, Any]]:
    return [
        {
            "name": wall.name,
            "chains": [_points(chain) for chain in wall.chains],
            "friction": b.friction,
            "elasticity": b.elasticity,
        }
        for wall, b in zip(world.walls, scene.boundaries, strict=True)
    ]


def _object(scene: Scene, index: int, body: Body) -> dict[str, Any]:
    item = scene.objects[index]
    shape = f"circle, r {body.radius:.1f} px" if body.radius is not None else _polygon(body)
    return {
        "name": item.name,
        "label": item.label,
        "path": " ".join(f"M{_points(ring + body.center)}Z" for ring in body.rings),
        "shape": shape,
        "mass": f"{body.mass:,.4g}" if body.mass < 1e6 else f"{body.mass:.3e}",
        "moment": f"{body.moment:.3e}",
        "friction": f"{item.friction:g}",
        "elasticity": f"{item.elasticity:g}",
        "velocity": f"{body.velocity[0]:g}, {body.velocity[1]:g}",
        "spin": f"{degrees(body.spin):g}",
        "motion": item.motion.value,
        "provenance": ", ".join(f"{key}: {source}" for key, source in item.provenance.items()),
    }


def _polygon(body: Body) -> str:
    corners = sum(len(ring) for ring in body.rings)
    pieces = f", {len(body.pieces)} pieces" if len(body.pieces) > 1 else ""
    return f"polygon, {corners} corners{pieces}"


def _arrows(world: World) -> list[dict[str, Any]]:
    """Velocities and forces, each kind to a scale of its own."""
    diagonal = float(np.hypot(*world.size))
    found: dict[str, list[tuple[Array, Array, str]]] = {"velocity": [], "force": []}
    for body in world.bodies:
        if body.velocity.any():
            title = f"{body.name}: {body.velocity[0]:g}, {body.velocity[1]:g} px/s"
            found["velocity"].append((body.center, body.velocity, title))
    for push in world.pushes:
        if push.load is Load.TORQUE:
            continue
        body = world.bodies[push.body]
        unit = "g·px/s" if push.load is Load.IMPULSE else "g·px/s²"
        title = f"{push.load.value} on {body.name}: {push.vector[0]:g}, {push.vector[1]:g} {unit} from {push.start:g} s"
        found["force"].append((body.center + push.at, push.vector, title))
    arrows = []
    for kind, rows in found.items():
        largest = max((float(np.hypot(*vector)) for _, vector, _ in rows), default=0.0)
        for start, vector, title in rows:
            if largest > 0:
                end = start + vector / largest * LONGEST_ARROW * diagonal
                x1, y1, x2, y2 = (round(float(v), 1) for v in (*start, *end))
                arrows.append({"kind": kind, "x1": x1, "y1": y1, "x2": x2, "y2": y2, "title": title})
    return arrows


def _engine(record: RunRecord) -> list[str]:
    """What the engine did to be exact, in sentences."""
    effort = record.effort
    if not effort:
        return []
    said = [
        f"{effort['steps']:,} steps, up to {effort['iterations']} sweeps of the contact solver each; "
        f"{effort['impacts']:,} blows, one after the other."
    ]
    if effort["divided"]:
        said.append(
            f"{effort['divided']:,} steps were divided, into up to {effort['most_parts']} parts, so that nothing fast "
            "passes through anything and stiff springs swing truly."
        )
    said.append(f"Contacts that close more slowly than {effort['still']:.3g} px/s do not bounce.")
    said.append(f"The books of energy close to {100 * record.imbalance:.2g} % of what flows.")
    return said


def _chaos(record: RunRecord) -> dict[str, Any] | None:
    """The chaos report as rows of a table; None where it was not asked for."""
    if record.chaos is None:
        return None
    rows = [
        {
            "name": name,
            "parted": "stays" if found["parted_s"] is None else f"{found['parted_s']:.3f} s",
            "runs": [f"{run['distance_px']:.2g}" for run in found["runs"]],
        }
        for name, found in record.chaos["objects"].items()
    ]
    return {"verdict": record.chaos["verdict"], "runs": record.chaos["runs"], "rows": rows}


def _world_facts(scene: Scene, world: World) -> list[tuple[str, str, str]]:
    scale = world.pixels_per_meter
    gravity = float(np.hypot(*world.gravity))
    facts = [
        ("view", world.view.value, ""),
        ("scale", f"{scale:g} px/m", ""),
        ("gravity", f"{world.gravity[0]:g}, {world.gravity[1]:g} px/s²", f"{gravity / scale:.3g} m/s²"),
        (
            "canvas",
            f"{world.size[0]} × {world.size[1]} px",
            f"{world.size[0] / scale:.3g} × {world.size[1] / scale:.3g} m",
        ),
        ("duration", f"{world.duration:g} s", ""),
        ("video", f"{scene.video_size[0]} × {scene.video_size[1]} px", _played(scene.render)),
        ("engine", f"{world.steps_per_second:g} steps/s", ""),
        ("coefficients", world.combine.value, ""),
    ]
    if world.view is View.TOP:
        facts.append(("table friction", f"{scene.world.table_friction:g}", ""))
    return facts


def _played(render: Render) -> str:
    """How the clip differs from the motion as it is, and from all of the photo; nothing where it does not."""
    told = [
        f"{render.slow:g} times slower" if render.slow != 1 else "",
        render.play.value if render.play is not Play.FORWARD else "",
        "through a camera" if render.camera else "",
    ]
    return ", ".join(part for part in told if part)
