"""Ask a vision-language server for the edits by which a sentence comes true."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import degrees
from typing import TYPE_CHECKING, Any, Protocol

import cv2
import numpy as np

from physgen.compile.compile import CompiledScene
from physgen.compile.world import World
from physgen.files import install
from physgen.maps import U8, png_bytes
from physgen.messages import Message, Note
from physgen.pipeline import stages
from physgen.pipeline.story import (
    LIMITS,
    Start,
    Telling,
    fulfilment,
    sampled_motion,
    scene_names,
    story_edits,
    tell_story,
)
from physgen.pipeline.story_proposals import (
    ProposalRules,
    UnsuitableEditError,
    object_table,
    proposal_rules,
    scene_edits,
)
from physgen.pipeline.story_words import STORY, Story, read_story
from physgen.problems import InputError, Place, Warn
from physgen.registry import Plan, Setup, find, missing_parts
from physgen.report.overview import overview_png
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory, new_touches
from physgen.text import listed, quoted

if TYPE_CHECKING:
    from physgen.perceive.backends.vlm import Query, Turn

TRIES = 3
"""Proposals that are simulated, or found to be unusable."""
FRAMES = 4
"""Pictures of a motion that the model sees, evenly spread."""
PICTURE = 512
"""px: the longer side of such a picture, at most."""
MOVED = 3.0
"""px from which an object has moved, for the words about an outcome."""
TURNED = 5.0
"""degrees from which it has turned."""
ROLE = "physics"
"""The role whose row in the table of backends has the server's settings."""

QUESTION = """\
The picture shows a scene that is simulated as rigid bodies in the picture's plane; names
are written beside the objects. All objects begin at rest. Propose edits after which this
happens: {text}

{table}

The actions: push sets the velocity [right, down] of an object at the beginning, in m/s;
spin its rate of turn, degrees/s clockwise; drop lifts an object by a height in m before it
falls; force acts on it, [right, down] in N, from start for duration, in s, at its middle or
top; remove takes an object away; add adds one of a size [width, height] in px and a mass
in g, with its center in px. Use the gentlest motion that makes it happen.
Answer with one JSON object that keeps to this schema:
{schema}"""
OUTCOME = """\
The simulation of your proposal, with {count} frames of it in the order of time: {outcome}.
{verdict} Propose all edits anew, from rest, as one JSON object of the same schema."""
MEASURED = "That is {share:.0%} of what was asked for."
JUDGE = (
    "Judge in `nearness`, 0 to 1, how near this outcome comes to what was asked for: 1 if "
    "it happened; then leave `edits` empty."
)
AGAIN = "That cannot be used: {fault}. Answer again, with one JSON object alone."


class StoryServer(Protocol):
    """A model that answers a conversation."""

    def reply(self, query: Query, turns: list[Turn]) -> str:
        """Return the reply. Raises InputError if the server fails."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


@dataclass(frozen=True)
class StoryScene:
    """A scene in which a story is to happen."""

    scene: Scene
    compiled: CompiledScene
    edited: Callable[[Mapping[str, Any]], Scene]
    """The scene after edits by dotted key. Raises InputError."""
    picture: bytes | None = None
    """The overview, PNG; None: drawn from the scene."""
    may_change_objects: bool = True
    """Whether objects may be added and removed."""


def tell(subject: StoryScene, text: str, plan: Plan, warn: Warn) -> Telling:
    """Return the edits by which a sentence comes true.

    A server that the plan's settings name is asked; without one, and if it fails, which
    `warn` receives, pushes are tried. Raises InputError.
    """
    server = _configured_server(plan, warn)
    if server is not None:
        try:
            telling = ask_server(server, subject, text)
            if telling is not None:
                return telling
            warn(Message.STORY_ANSWERS_UNUSABLE.warning(Place(STORY), "", quoted(text)))
        except InputError as error:
            for problem in error.problems:
                reason = f"{problem.found} {problem.expected}".strip()
                failed = Message.STORY_SERVER_FAILED
                warn(failed.warning(Place(STORY), "", reason, fix=problem.fix))
        finally:
            server.close()
    return tell_story(subject.scene, subject.compiled, text)


def _configured_server(plan: Plan, warn: Warn) -> StoryServer | None:
    """Return the server that the settings name, None without one or its library."""
    row = find(ROLE, "vlm")
    options = plan.options.get("vlm", {})
    missing = missing_parts(row, plan)
    packages = row.missing()
    if any(part.startswith("set ") for part in missing):
        return None
    if packages:
        fix = install("models")
        absent = Message.STORY_SERVER_FAILED
        warn(absent.warning(Place(STORY), "", listed(packages, "and"), fix=fix))
        return None
    # the library takes a second to load
    from physgen.perceive.backends.vlm import Story as Server

    return Server(Setup(options=options))


@dataclass
class _Talk:
    """The conversation about a story, and the best proposal so far."""

    subject: StoryScene
    text: str
    rules: ProposalRules
    is_judge: bool
    """Whether the model judges outcomes, since the sentence is not understood."""
    turns: list[Any] = field(default_factory=list)
    best: Telling | None = None
    best_share: float = -1.0
    last: Telling | None = None
    tried: int = 0
    drawing: stages.Stages = field(default_factory=stages.Stages)

    def keep(self, telling: Telling, share: float) -> None:
        """Keep an outcome if it is nearer than those before."""
        if share > self.best_share:
            self.best, self.best_share = telling, share


def ask_server(server: StoryServer, subject: StoryScene, text: str) -> Telling | None:
    """Return the outcome of the first right proposal, or the nearest of TRIES.

    None if no answer can be used. Raises InputError if the server fails.
    """
    from physgen.perceive.backends.vlm import (
        Query,
        Turn,
        UnusableAnswerError,
        parse_answer,
        plain_line,
    )

    is_judge = _understood(text, subject.scene, subject.compiled.world) is None
    rules = proposal_rules(subject.scene, subject.may_change_objects, is_judge)
    query = Query("the scene", "", (), rules.outline, rules.faults)
    talk = _Talk(subject, text, rules, is_judge)
    opening = QUESTION.format(
        text=plain_line(text),
        table=object_table(subject.scene, subject.compiled.world),
        schema=_json(rules.schema),
    )
    talk.turns.append(Turn(opening, (_overview(talk),)))
    # a judge answers once more, about its last proposal
    for attempt in range(TRIES + is_judge):
        reply = server.reply(query, talk.turns)
        talk.turns.append(Turn(plain_line(reply, 4000) or "(nothing)", is_reply=True))
        try:
            answer = parse_answer(reply, query)
            if _is_accepted(talk, answer) or attempt == TRIES:
                break
            message, pictures, is_right = _simulate_proposal(talk, answer["edits"])
        except (UnusableAnswerError, UnsuitableEditError) as error:
            message, pictures, is_right = AGAIN.format(fault=error), (), False
        if is_right:
            break
        talk.turns.append(Turn(message, pictures))
    return talk.best


def _json(value: Any) -> str:
    import json

    return json.dumps(value)


def _understood(text: str, scene: Scene, world: World) -> Story | None:
    """Return what a sentence wants, None if it is not understood."""
    try:
        return read_story(text, scene_names(scene, world))
    except InputError:
        return None


def _is_accepted(talk: _Talk, answer: Mapping[str, Any]) -> bool:
    """Take the model's judgement of its last outcome; return whether it happened."""
    if talk.last is None or not talk.is_judge:
        return False
    share = float(answer.get("nearness", 0.0))
    is_right = share >= LIMITS.partial
    last = talk.last
    talk.keep(Telling(last.edits, is_right, last.outcome, talk.tried), share)
    talk.last = None
    return is_right


def _simulate_proposal(
    talk: _Talk, edits: list[Any]
) -> tuple[str, tuple[bytes, ...], bool]:
    """Simulate a proposal; return the message about it, frames, whether it is right.

    Raises UnsuitableEditError.
    """
    subject = talk.subject
    quiet = story_edits(subject.scene, subject.compiled, Start(0, is_moved=False))
    values = scene_edits(subject.scene, subject.compiled.world, quiet, edits)
    try:
        scene = subject.edited(values)
        maps = talk.drawing.maps(scene)
        compiled = talk.drawing.compile(scene, maps)
        motion = sampled_motion(compiled.world)
    except InputError as error:
        reasons = [f"{one.path} {one.found} {one.expected}" for one in error.problems]
        raise UnsuitableEditError("; ".join(reasons)) from None
    talk.tried += 1
    outcome = motion_words(compiled.world, motion)
    story = _understood(talk.text, scene, compiled.world)
    share, verdict = 0.0, JUDGE
    if not talk.is_judge:
        share = _share(story, compiled.world, motion)
        verdict = MEASURED.format(share=share)
    is_right = share >= LIMITS.partial
    telling = Telling(values, is_right, outcome, talk.tried)
    talk.last = telling
    talk.keep(telling, share if not talk.is_judge else -0.5)
    if is_right:
        return "", (), True
    frames = _frames(talk, scene, compiled, motion)
    message = OUTCOME.format(count=len(frames), outcome=outcome, verdict=verdict)
    return message, frames, False


def _share(story: Story | None, world: World, motion: Trajectory) -> float:
    """Return how far a motion is what a story wants, by the best of its actors."""
    if story is None:
        return 0.0
    shares = [fulfilment(world, story, Start(actor), motion) for actor in story.actors]
    return max(shares, default=0.0)


def motion_words(world: World, motion: Trajectory) -> str:
    """Return what happens to each object in a motion, in words."""
    surfaces = [name for name, _ in world.surfaces]
    pairs = motion.contacts.touch_pairs[new_touches(motion)].tolist()
    sentences = []
    for k, name in enumerate(surfaces[: len(world.bodies)]):
        parts = []
        right, down = (motion.poses[-1, k, :2] - motion.poses[0, k, :2]).tolist()
        if max(abs(right), abs(down)) >= MOVED:
            parts.append(f"ends {right:+.0f} px right and {down:+.0f} px down")
        angles = motion.poses[:, k, 2] - motion.poses[0, k, 2]
        turn = degrees(float(np.abs(angles).max()))
        if turn >= TURNED and world.bodies[k].radius is None:
            parts.append(f"turns by up to {turn:.0f} degrees")
        hit = sorted({one for row in pairs if k in row for one in row} - {k})
        if hit:
            others = listed([surfaces[one] for one in hit], "and")
            parts.append(f"touches {others}")
        if parts:
            sentences.append(f"{name} {', '.join(parts)}")
    return "; ".join(sentences) or Note.STORY_NOTHING_MOVES.value


def _overview(talk: _Talk) -> bytes:
    """Return the overview of the scene, PNG."""
    subject = talk.subject
    if subject.picture is not None:
        return subject.picture
    maps = talk.drawing.maps(subject.scene)
    if maps.percepts is not None:
        rgb, labels = maps.percepts.rgb, maps.percepts.labels
        return overview_png(rgb, labels, subject.scene.document, {})
    motion = sampled_motion(subject.compiled.world)
    return _frames(talk, subject.scene, subject.compiled, motion)[0]


def _frames(
    talk: _Talk, scene: Scene, compiled: CompiledScene, motion: Trajectory
) -> tuple[bytes, ...]:
    """Return pictures of a motion, PNG, evenly spread until its end."""
    times = compiled.world.duration * np.arange(1, FRAMES + 1) / FRAMES
    stage = talk.drawing.stage(scene, compiled, talk.drawing.maps(scene))
    frames = stages.render(stage, motion.sampled(times))
    return tuple(_small_png(frame.rgb) for frame in frames)


def _small_png(rgb: U8) -> bytes:
    factor = min(1.0, PICTURE / max(rgb.shape[:2]))
    size = round(rgb.shape[1] * factor), round(rgb.shape[0] * factor)
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    return png_bytes(np.asarray(small, np.uint8))
