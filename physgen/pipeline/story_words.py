"""Read a sentence about a scene: actor, target, direction and strength of a motion."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from physgen.messages import Message
from physgen.text import listed, quoted

STORY = "story"
"""The place of problems of a sentence, as long as nothing better is known."""


class Wish(Enum):
    """The event that a sentence asks for."""

    TURN = "falls over"
    """A target turns by `FALLEN` degrees."""
    TOUCH = "is hit"
    """The actor touches a target."""
    SHIFT = "moves"
    """The actor moves in a direction."""
    DROP = "falls"
    """The actor or a target ends lower."""
    RISE = "rises"
    """The actor or a target is lifted."""
    SPIN = "spins"
    """The actor turns on the spot."""
    HALT = "stays"
    """The actor has no velocity at the start."""


@dataclass(frozen=True)
class NamedItem:
    """An object or a boundary with all words by which a sentence may name it."""

    index: int
    """Index in `World.surfaces`."""
    name: str
    words: frozenset[str]
    """All words of its name and label, in the singular."""
    nouns: frozenset[str]
    """Words that name it alone: the last words of its name and of its label."""
    x: float
    """Coordinates of its centre, px."""
    y: float
    is_object: bool = True


@dataclass(frozen=True)
class Mention:
    """A noun phrase of a sentence."""

    members: tuple[int, ...]
    """Surfaces that the phrase may mean."""
    start: int
    """Index of the first word."""
    end: int
    """Index after the last word."""
    needs_all: bool = False
    """Whether the phrase means all members, not one of them."""


@dataclass(frozen=True)
class Story:
    """The meaning of a sentence."""

    wish: Wish
    actors: tuple[int, ...]
    """Candidates for the moved object, the best first."""
    targets: tuple[int, ...]
    """Surfaces that the event happens to; empty for the actor itself."""
    needs_all: bool
    """Whether the event must happen to all targets."""
    direction: tuple[int, int] | None
    """Steps to the right and down; None without a direction."""
    strength: float
    """Factor of the speed: below 1 for gentle, above 1 for hard."""
    must_rest: bool = False
    """Whether the actor must rest at the end."""
    precedes_verb: bool = False
    """Whether the actor precedes the verb, so that it may move by itself."""


VERBS = {
    "knock": Wish.TURN,
    "topple": Wish.TURN,
    "tip": Wish.TURN,
    "tilt": Wish.TURN,
    "upset": Wish.TURN,
    "overturn": Wish.TURN,
    "hit": Wish.TOUCH,
    "strike": Wish.TOUCH,
    "bump": Wish.TOUCH,
    "break": Wish.TOUCH,
    "smash": Wish.TOUCH,
    "crash": Wish.TOUCH,
    "collide": Wish.TOUCH,
    "touch": Wish.TOUCH,
    "meet": Wish.TOUCH,
    "push": Wish.SHIFT,
    "slide": Wish.SHIFT,
    "shove": Wish.SHIFT,
    "move": Wish.SHIFT,
    "roll": Wish.SHIFT,
    "drive": Wish.SHIFT,
    "throw": Wish.SHIFT,
    "toss": Wish.SHIFT,
    "kick": Wish.SHIFT,
    "flick": Wish.SHIFT,
    "shoot": Wish.SHIFT,
    "drop": Wish.DROP,
    "fall": Wish.DROP,
    "lift": Wish.RISE,
    "raise": Wish.RISE,
    "jump": Wish.RISE,
    "spin": Wish.SPIN,
    "rotate": Wish.SPIN,
    "turn": Wish.SPIN,
    "stop": Wish.HALT,
    "rest": Wish.HALT,
}
"""Verbs in their base form."""
AGAINST = ("into", "at", "against", "onto", "until", "towards", "toward", "to", "and")
"""Words in front of the target of a motion."""
WAYS = {
    "right": (1, 0),
    "rightwards": (1, 0),
    "left": (-1, 0),
    "leftwards": (-1, 0),
    "up": (0, -1),
    "upwards": (0, -1),
    "down": (0, 1),
    "downwards": (0, 1),
}
GENTLE = ("gently", "softly", "slowly", "slightly", "lightly")
HARD = ("hard", "fast", "quickly", "strongly", "violently", "far")
STRENGTHS = {**dict.fromkeys(GENTLE, 0.5), **dict.fromkeys(HARD, 2.0)}
ALL = ("all", "every", "each", "everything")
OTHERS = ("other", "rest", "rack", "them", "everything")
"""Words for all objects except the actor."""
PLACES = ("first", "last", "leftmost", "rightmost", "left", "right", "top", "bottom")
"""Words that select one of several objects by its place."""
SURROUNDINGS = (
    "air", "ground", "floor", "table", "wall", "shelf", "picture", "photo", "side",
    "middle", "spot", "ramp", "way", "edge",
)  # fmt: skip
"""Nouns that need not name objects of the scene."""
ARTICLES = ("the", "a", "an", "its", "this", "that", "of")
PLURALS = {"knives": "knife", "shelves": "shelf", "boxes": "box", "dominoes": "domino"}


def singular(word: str) -> str:
    """Return a word in the singular.

    >>> singular("cans"), singular("glass"), singular("boxes")
    ('can', 'glass', 'box')
    """
    if word in PLURALS:
        return PLURALS[word]
    if word.endswith("s") and not word.endswith("ss") and len(word) > 3:
        return word[:-1]
    return word


def split_words(text: str) -> list[str]:
    """Return the words of a text in lower case; names keep their hyphens."""
    return re.findall(r"[a-z0-9]+(?:-[a-z0-9]+)*", text.lower())


def name_words(
    index: int, name: str, label: str, place: tuple[float, float]
) -> NamedItem:
    """Return an object with the words of its name and label."""
    name_parts = list(map(singular, re.findall(r"[a-z]+|\d+", name.lower())))
    label_parts = list(map(singular, re.findall(r"[a-z]+|\d+", label.lower())))
    nouns = set()
    for parts in (name_parts, label_parts):
        letters = []
        for part in parts:
            if not part.isdigit():
                letters.append(part)
        nouns.update(letters[-1:])
    words = frozenset([*name_parts, *label_parts])
    return NamedItem(index, name.lower(), words, frozenset(nouns), *place)


def read_story(text: str, candidates: Sequence[NamedItem]) -> Story:
    """Read the meaning of a sentence. Raises InputError for an unknown object
    or verb.
    """
    words = split_words(text)
    mentions = find_mentions(words, candidates)
    verbs = _find_verbs(words, mentions)
    if not verbs:
        raise Message.STORY_WITHOUT_VERB.error(STORY, quoted(text), verbs=listed(VERBS))
    objects = []
    for candidate in candidates:
        if candidate.is_object:
            objects.append(candidate)
    names = listed([candidate.name for candidate in objects])
    unknown_noun = _unknown_noun(words, mentions)
    if unknown_noun:
        subject = f"{unknown_noun}, in {quoted(text)},"
        raise Message.STORY_NOUN_UNKNOWN.error(STORY, subject, names=names)
    # A mention of boundaries alone, as in "the floor shakes", moves nothing.
    indices = {candidate.index for candidate in objects}
    if indices.isdisjoint(k for mention in mentions for k in mention.members):
        raise Message.STORY_WITHOUT_OBJECT.error(STORY, quoted(text), names=names)
    return _assemble(words, mentions, verbs, indices)


def _find_verbs(
    words: Sequence[str], mentions: Sequence[Mention]
) -> list[tuple[int, str]]:
    """Return the places and the base forms of the verbs.

    A word within a noun phrase is not a verb: the "roll" of a "paper roll".
    """
    verbs = []
    for k, word in enumerate(words):
        verb = verb_of(word)
        if verb and not any(m.start <= k < m.end for m in mentions):
            verbs.append((k, verb))
    return verbs


def _unknown_noun(words: Sequence[str], mentions: Sequence[Mention]) -> str:
    """Find the first unknown noun after an article; empty without one."""
    known_words = {*WAYS, *OTHERS, *ALL, *PLACES, *SURROUNDINGS}
    for k in range(1, len(words)):
        is_named = _is_within_phrase(k, mentions) or singular(words[k]) in known_words
        if words[k - 1] in ("the", "a", "an") and not is_named:
            return words[k]
    return ""


def verb_of(word: str) -> str:
    """Return the base form of a verb; empty for other words.

    >>> verb_of("knocks"), verb_of("rolling"), verb_of("table")
    ('knock', 'roll', '')
    """
    for ending in ("", "s", "es", "ing", "ed"):
        if ending:
            base = word.removesuffix(ending)
        else:
            base = word
        for candidate in (base, base + "e", base[:-1]):
            if candidate in VERBS:
                return candidate
    return ""


def find_mentions(
    words: Sequence[str], candidates: Sequence[NamedItem]
) -> list[Mention]:
    """Find the noun phrases of a sentence that name candidates, from left to right."""
    mentions: list[Mention] = []
    position = 0
    while position < len(words):
        mention = _mention_at(words, position, candidates)
        if mention is None:
            position += 1
        else:
            mentions.append(mention)
            position = mention.end
    return mentions


def _mention_at(
    words: Sequence[str], start: int, candidates: Sequence[NamedItem]
) -> Mention | None:
    """Find the longest noun phrase from a word on."""
    for end in range(min(start + 6, len(words)), start, -1):
        phrase = []
        for word in words[start:end]:
            if word not in ARTICLES:
                phrase.append(word)
        if not phrase or words[start] in ARTICLES or words[end - 1] in ARTICLES:
            continue
        members, needs_all = _members(phrase, candidates)
        if members:
            return Mention(members, start, end, needs_all)
    return None


def _members(
    phrase: Sequence[str], candidates: Sequence[NamedItem]
) -> tuple[tuple[int, ...], bool]:
    """Return the candidates of a phrase, and whether all of them are meant."""
    for candidate in candidates:
        if _is_name_of(candidate, phrase):
            return (candidate.index,), False
    needs_all = any(word in ALL for word in phrase)
    places = [word for word in phrase[:-1] if word in PLACES]
    name_parts = _name_parts(phrase, places)
    if not name_parts:
        return (), False
    matches = _candidates_with_words(name_parts, candidates)
    if places and len(matches) > 1:
        matches = [_select_by_place(matches, places[0])]
    return tuple(candidate.index for candidate in matches), needs_all


def _is_name_of(candidate: NamedItem, phrase: Sequence[str]) -> bool:
    """Return whether a phrase is the full name, or a noun and the name."""
    if candidate.name == "-".join(phrase):
        return True
    has_noun = len(phrase) == 2 and singular(phrase[0]) in candidate.words
    return has_noun and candidate.name == phrase[1]


def _name_parts(phrase: Sequence[str], places: Sequence[str]) -> list[str]:
    """Return the words of a phrase that belong to a name, in the singular."""
    name_parts = []
    for word in phrase:
        part = singular(word)
        if word not in (*ALL, *places) and part not in ("and", "other", "one"):
            name_parts.append(part)
    return name_parts


def _candidates_with_words(
    name_parts: Sequence[str], candidates: Sequence[NamedItem]
) -> list[NamedItem]:
    """Return the candidates of exactly this name, or else of all these words."""
    # A number may follow the noun: "domino 5".
    noun = next((word for word in reversed(name_parts) if not word.isdigit()), "")
    matches = []
    exact_matches = []
    for candidate in candidates:
        if noun in candidate.nouns and set(name_parts) <= candidate.words:
            matches.append(candidate)
            if "-".join(name_parts) == candidate.name:
                exact_matches.append(candidate)
    return exact_matches or matches


def _select_by_place(candidates: Sequence[NamedItem], place: str) -> NamedItem:
    """Select the first, last, top ... of several candidates."""
    if place in ("top", "bottom"):
        sorted_candidates = sorted(candidates, key=lambda candidate: candidate.y)
        if place == "top":
            return sorted_candidates[0]
        return sorted_candidates[-1]
    sorted_candidates = sorted(candidates, key=lambda candidate: candidate.x)
    if place in ("first", "left", "leftmost"):
        return sorted_candidates[0]
    return sorted_candidates[-1]


def _assemble(
    words: Sequence[str],
    mentions: Sequence[Mention],
    verbs: Sequence[tuple[int, str]],
    objects: set[int],
) -> Story:
    """Combine mentions, verbs and the remaining words into a story."""
    place, verb = verbs[0]
    actor, targets = _actor_and_targets(mentions, place, objects)
    # Words that belong to no mention tell direction and strength: "gently to the
    # left".
    earlier_words, later_words = _split_free_words(words, mentions, place)
    free_words = earlier_words + later_words
    direction = _direction(free_words)
    later_wishes = _wishes(verbs[1:])
    has_target = bool(targets) and _has_target(words, targets[-1], later_wishes)
    wish = _event(VERBS[verb], words, has_target, direction)
    actor_indices = tuple(k for k in actor.members if k in objects)
    target_indices, needs_all = _targets(
        wish, targets, actor, objects, later_words, words
    )
    return Story(
        wish,
        actor_indices,
        tuple(target_indices),
        needs_all,
        _push_direction(wish, direction),
        _strength(free_words),
        must_rest=wish is not Wish.HALT and Wish.HALT in later_wishes,
        precedes_verb=mentions[0].end <= place,
    )


def _wishes(verbs: Sequence[tuple[int, str]]) -> set[Wish]:
    """Return the events that verbs with their places ask for."""
    return {VERBS[verb] for _, verb in verbs}


def _actor_and_targets(
    mentions: Sequence[Mention], place: int, objects: set[int]
) -> tuple[Mention, list[Mention]]:
    """Return the mention of the actor, and those of the objects of a verb at `place`.

    The actor precedes the verb; in an imperative sentence it follows the verb.
    """
    objects_of_verb = []
    for mention in mentions:
        if mention.start > place:
            objects_of_verb.append(mention)
    # An object before the verb is its subject.
    if mentions[0].end <= place:
        return mentions[0], objects_of_verb
    # "Push the ball against the wall": the first object moves, the others are hit.
    actor = _first_object(objects_of_verb, objects)
    targets = []
    for mention in objects_of_verb:
        if mention is not actor:
            targets.append(mention)
    return actor, targets


def _split_free_words(
    words: Sequence[str], mentions: Sequence[Mention], place: int
) -> tuple[list[str], list[str]]:
    """Return the words outside of mentions up to a verb at `place`, and after it."""
    earlier_words, later_words = [], []
    for k, word in enumerate(words):
        if _is_within_phrase(k, mentions):
            continue
        if k > place:
            later_words.append(word)
        else:
            earlier_words.append(word)
    return earlier_words, later_words


def _push_direction(
    wish: Wish, direction: tuple[int, int] | None
) -> tuple[int, int] | None:
    """Return the direction of the push for an event, if the sentence contains one.

    "Knocks down" and "rolls down to" contain none.
    """
    is_vertical = direction is not None and not direction[0]
    if wish in (Wish.TURN, Wish.TOUCH) and is_vertical:
        return None
    return direction


def _strength(words: Sequence[str]) -> float:
    """Return the factor of the speed that the words ask for."""
    strength = 1.0
    for word in words:
        strength *= STRENGTHS.get(word, 1.0)
    return strength


def _event(
    wish: Wish,
    words: Sequence[str],
    has_target: bool,
    direction: tuple[int, int] | None,
) -> Wish:
    """Return the event of a verb's wish in a whole sentence."""
    # A motion into something is an impact, an upward motion is a lift, and an object
    # knocked off its support falls.
    if wish is Wish.SHIFT and has_target:
        return Wish.TOUCH
    if wish is Wish.SHIFT and direction == (0, -1):
        return Wish.RISE
    if wish is Wish.TURN and "off" in words:
        return Wish.DROP
    return wish


def _targets(
    wish: Wish,
    mentions: Sequence[Mention],
    actor: Mention,
    objects: set[int],
    later_words: Sequence[str],
    words: Sequence[str],
) -> tuple[list[int], bool]:
    """Return the targets of an event, and whether it must happen to all of them.

    `mentions`: of possible targets; `later_words`: those after the verb outside of
    mentions.
    """
    if wish not in (Wish.TURN, Wish.TOUCH, Wish.RISE, Wish.DROP):
        return [], False
    targets: list[int] = []
    needs_all = False
    if mentions:
        targets = []
        for k in mentions[-1].members:
            if k not in actor.members:
                targets.append(k)
        needs_all = mentions[-1].needs_all
    # "Knocks the others over" names its targets only by a pronoun.
    if not targets and any(word in OTHERS for word in later_words):
        targets = sorted(objects - set(actor.members))
        needs_all = any(word in ALL for word in words)
    return targets, needs_all


def _is_within_phrase(k: int, mentions: Sequence[Mention]) -> bool:
    """Check whether a word belongs to a mention."""
    return any(mention.start <= k < mention.end for mention in mentions)


def _first_object(mentions: Sequence[Mention], objects: set[int]) -> Mention:
    """Return the first mention of an object: without a subject, this object is the
    actor.
    """
    for mention in mentions:
        if set(mention.members) & objects:
            return mention
    return mentions[0]


def _has_target(words: Sequence[str], mention: Mention, later: set[Wish]) -> bool:
    """Check whether a motion ends at a mention: "into the egg", "and hits the
    blocks".
    """
    preceding = words[max(mention.start - 3, 0) : mention.start]
    return Wish.TOUCH in later or any(word in AGAINST for word in preceding)


def _direction(words: Sequence[str]) -> tuple[int, int] | None:
    """Return the direction of the words, right and down; a sideways word has
    priority.
    """
    directions = []
    for word in words:
        if word in WAYS:
            directions.append(WAYS[word])
    sideways_directions = []
    for direction in directions:
        if direction[0]:
            sideways_directions.append(direction)
    choices = sideways_directions or directions
    if choices:
        return choices[0]
    return None
