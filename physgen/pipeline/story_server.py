"""Ask a vision-language server for the edits by which a sentence comes true."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import degrees
from typing import TYPE_CHECKING, Any, Protocol

import cv2
import numpy as np

from physgen.compile.compile import CompiledScene
from physgen.compile.world import World
from physgen.files import install
from physgen.maps import U8, Percepts, png_bytes
from physgen.messages import Message, Note
from physgen.perceive import backends
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
from physgen.registry import load_plan as load_plan
from physgen.report.overview import overview_png
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory, new_touches
from physgen.text import listed, quoted

if TYPE_CHECKING:
    from physgen.perceive.backends.vlm import Turn
    from physgen.perceive.backends.vlm_questions import Query

LONGEST_REPLY = 4000
"""Characters of a reply that the conversation keeps."""
UNJUDGED = -0.5
"""Merit of an outcome that the model has not judged yet."""
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
    compiled_scene: CompiledScene
    apply_edits: Callable[[Mapping[str, Any]], Scene]
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
            telling = ask_server(server, subject, text, warn)
        finally:
            server.close()
        if telling is not None:
            return telling
    return tell_story(subject.scene, subject.compiled_scene, text)


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
    server: StoryServer = _vlm().Story(Setup(options=options))
    return server


def _vlm() -> Any:
    """Return the backend's module, whose library takes a second to load."""
    return backends.vlm


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
    trials: int = 0
    drawing: stages.Stages = field(default_factory=stages.Stages)

    def say(
        self, text: str, pictures: tuple[bytes, ...] = (), *, is_reply: bool = False
    ) -> None:
        """Add a message."""
        self.turns.append(_vlm().Turn(text, pictures, is_reply))

    def keep(self, telling: Telling, share: float) -> None:
        """Keep an outcome if it is nearer than those before."""
        if share > self.best_share:
            self.best = telling
            self.best_share = share


def ask_server(
    server: StoryServer, subject: StoryScene, text: str, warn: Warn
) -> Telling | None:
    """Return the outcome of the first right proposal, or the nearest of TRIES.

    If the server fails, it is the nearest so far. None if no answer can be used. `warn`
    receives the reason. Raises InputError if the scene cannot be drawn.
    """
    talk = _open_talk(subject, text)
    query = _vlm().Query("the scene", "", (), talk.rules.outline, talk.rules.faults)
    # a judge answers once more, about its last proposal
    for attempt in range(TRIES + talk.is_judge):
        try:
            reply = server.reply(query, talk.turns)
        except InputError as error:
            _warn_of_failure(error, talk.best is not None, warn)
            return talk.best
        talk.say(_vlm().plain_line(reply, LONGEST_REPLY) or "(nothing)", is_reply=True)
        try:
            answer = _vlm().parse_answer(reply, query)
        except _vlm().UnusableAnswerError as error:
            talk.say(AGAIN.format(fault=error))
            continue
        if _accepts_outcome(talk, answer) or attempt == TRIES:
            break
        if _take_proposal(talk, answer["edits"]):
            break
    if talk.best is None:
        warn(Message.STORY_ANSWERS_UNUSABLE.warning(Place(STORY), "", quoted(text)))
    return talk.best


def _warn_of_failure(error: InputError, has_best: bool, warn: Warn) -> None:
    """Tell why the server failed, and what is done instead."""
    failed = Message.STORY_SERVER_FAILED
    if has_best:
        failed = Message.STORY_SERVER_FAILED_LATER
    for problem in error.problems:
        reason = f"{problem.found} {problem.expected}".strip()
        warn(failed.warning(Place(STORY), "", reason, fix=problem.fix))


def _open_talk(subject: StoryScene, text: str) -> _Talk:
    """Return a conversation with its first question."""
    world = subject.compiled_scene.world
    is_judge = _try_to_read(text, subject.scene, world) is None
    rules = proposal_rules(subject.scene, subject.may_change_objects, is_judge)
    talk = _Talk(subject, text, rules, is_judge)
    table = object_table(subject.scene, world)
    schema = json.dumps(rules.schema)
    line = _vlm().plain_line(text)
    talk.say(QUESTION.format(text=line, table=table, schema=schema), (_overview(talk),))
    return talk


def _try_to_read(text: str, scene: Scene, world: World) -> Story | None:
    """Return what a sentence wants, None if it is not understood."""
    try:
        return read_story(text, scene_names(scene, world))
    except InputError:
        return None


def _accepts_outcome(talk: _Talk, answer: Mapping[str, Any]) -> bool:
    """Take the model's judgement of its last outcome; return whether it happened."""
    if talk.last is None or not talk.is_judge:
        return False
    share = float(answer.get("nearness", 0.0))
    is_right = share >= LIMITS.partial
    last = talk.last
    talk.keep(Telling(last.edits, is_right, last.outcome, talk.trials), share)
    talk.last = None
    return is_right


@dataclass(frozen=True)
class _Trial:
    """A simulated proposal."""

    values: dict[str, Any]
    """Edits by dotted key."""
    scene: Scene
    compiled_scene: CompiledScene
    motion: Trajectory


def _simulate(talk: _Talk, edits: list[Any]) -> _Trial:
    """Return the simulation of proposed edits. Raises UnsuitableEditError."""
    subject = talk.subject
    quiet = story_edits(
        subject.scene, subject.compiled_scene, Start(0, has_motion=False)
    )
    values = scene_edits(subject.scene, subject.compiled_scene.world, quiet, edits)
    try:
        scene = subject.apply_edits(values)
        compiled = talk.drawing.compile(scene, talk.drawing.maps(scene))
        return _Trial(values, scene, compiled, sampled_motion(compiled.world))
    except InputError as error:
        raise UnsuitableEditError(_reasons(error)) from None


def _reasons(error: InputError) -> str:
    """Return what is wrong with a proposal, in one line."""
    reasons = [f"{one.path} {one.found} {one.expected}" for one in error.problems]
    return "; ".join(reasons)


def _proposal_frames(talk: _Talk, trial: _Trial) -> tuple[bytes, ...]:
    """Return pictures of a proposal's motion. Raises UnsuitableEditError."""
    try:
        return _frames(talk, trial.scene, trial.compiled_scene, trial.motion)
    except InputError as error:
        raise UnsuitableEditError(_reasons(error)) from None


def _take_proposal(talk: _Talk, edits: list[Any]) -> bool:
    """Simulate a proposal and answer it; return whether it is right."""
    share = UNJUDGED
    verdict = JUDGE
    frames: tuple[bytes, ...] = ()
    try:
        trial = _simulate(talk, edits)
        # A sentence with a measurable wish is judged by the simulation, any other one
        # by the model that looks at the frames.
        if not talk.is_judge:
            share = _share(talk.text, trial)
            verdict = MEASURED.format(share=share)
        is_right = share >= LIMITS.partial
        if not is_right:
            frames = _proposal_frames(talk, trial)
    except UnsuitableEditError as error:
        talk.say(AGAIN.format(fault=error))
        return False
    # Edits that cannot be simulated are no trial: the model may correct them.
    talk.trials += 1
    outcome = motion_words(trial.compiled_scene.world, trial.motion)
    talk.last = Telling(trial.values, is_right, outcome, talk.trials)
    talk.keep(talk.last, share)
    if not is_right:
        values = {"count": len(frames), "outcome": outcome, "verdict": verdict}
        talk.say(OUTCOME.format(**values), frames)
    return is_right


def _share(text: str, trial: _Trial) -> float:
    """Return how far a motion is what a story wants, by the best of its actors."""
    world = trial.compiled_scene.world
    story = _try_to_read(text, trial.scene, world)
    if story is None:
        return 0.0
    best = 0.0
    for actor in story.actors:
        best = max(best, fulfilment(world, story, Start(actor), trial.motion))
    return best


def motion_words(world: World, motion: Trajectory) -> str:
    """Return what happens to each object in a motion, in words."""
    surfaces = [name for name, _ in world.surfaces]
    pairs = motion.contacts.touch_pairs[new_touches(motion)].tolist()
    sentences = []
    for k, name in enumerate(surfaces[: len(world.bodies)]):
        parts = _pose_words(world, motion, k)
        partners = sorted({other for row in pairs if k in row for other in row} - {k})
        if partners:
            others = listed([surfaces[partner] for partner in partners], "and")
            parts.append(f"touches {others}")
        if parts:
            sentences.append(f"{name} {', '.join(parts)}")
    return "; ".join(sentences) or Note.STORY_NOTHING_MOVES.value


def _pose_words(world: World, motion: Trajectory, k: int) -> list[str]:
    """Return how far a body moves and turns, in words; empty for small motions."""
    words = []
    right, down = (motion.poses[-1, k, :2] - motion.poses[0, k, :2]).tolist()
    if max(abs(right), abs(down)) >= MOVED:
        words.append(f"ends {right:+.0f} px right and {down:+.0f} px down")
    angles = motion.poses[:, k, 2] - motion.poses[0, k, 2]
    turn = degrees(float(np.abs(angles).max()))
    if turn >= TURNED and world.bodies[k].radius is None:
        words.append(f"turns by up to {turn:.0f} degrees")
    return words


def photo_overview(maps: Percepts, document: Mapping[str, Any]) -> bytes:
    """Return the overview of a photo's objects without pushes, PNG."""
    return overview_png(maps.rgb, maps.labels, document, {})


def _overview(talk: _Talk) -> bytes:
    """Return the overview of the scene, PNG."""
    subject = talk.subject
    if subject.picture is not None:
        return subject.picture
    maps = talk.drawing.maps(subject.scene)
    if maps.percepts is not None:
        return photo_overview(maps.percepts, subject.scene.document)
    motion = sampled_motion(subject.compiled_scene.world)
    return _frames(talk, subject.scene, subject.compiled_scene, motion)[0]


def _frames(
    talk: _Talk, scene: Scene, compiled_scene: CompiledScene, motion: Trajectory
) -> tuple[bytes, ...]:
    """Return pictures of a motion, PNG, evenly spread until its end."""
    times = compiled_scene.world.duration * np.arange(1, FRAMES + 1) / FRAMES
    stage = talk.drawing.stage(scene, compiled_scene, talk.drawing.maps(scene))
    frames = stages.render(stage, motion.resample(times))
    return tuple(_small_png(frame.rgb) for frame in frames)


def _small_png(rgb: U8) -> bytes:
    factor = min(1.0, PICTURE / max(rgb.shape[:2]))
    size = round(rgb.shape[1] * factor), round(rgb.shape[0] * factor)
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    return png_bytes(np.asarray(small, np.uint8))
