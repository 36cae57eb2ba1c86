"""Templates of all messages: one sentence and one fix for each kind of problem.

A message reads `place: path: found expected; fix`. A template holds `expected`, a verb
phrase with named fields, and `fix`, an imperative. The place, the path and the written
value are added when the problem is made:

>>> print(Message.TWICE_IN_LIST.refusal(value="3").expected)
has 3 twice

Each template has a code, by which programs tell problems apart; codes do not change
when a sentence is rewritten.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, unique
from string import Formatter

from physgen.problems import (
    EditError,
    InputError,
    Place,
    Problem,
    RefusedError,
    Severity,
    Why,
)
from physgen.text import KeyPath, dotted, listed, nearest, quoted


def did_you_mean(name: str) -> str:
    """Return the fix that asks for a similar name.

    >>> did_you_mean("ball")
    'did you mean "ball"?'
    """
    return f"did you mean {quoted(name)}?"


def one_of(name: str, known: Sequence[str]) -> str:
    """Return the fix of an unknown name: a similar one, or the names that exist.

    >>> one_of("bal", ["ball", "cup"]), one_of("moon", ["ball", "cup"])
    ('did you mean "ball"?', 'write ball or cup')
    """
    close = nearest(name, known)
    return did_you_mean(close) if close else f"write {listed(known[:MOST_NAMES])}"


CONVERT = "save it as MP4, GIF or WebP, or as a folder of PNG"
"""What to do about a video that cannot be read."""
MOST_NAMES = 30
"""Names that a fix lists; a reader looks up longer lists in the documentation."""


@unique
class Message(Enum):
    """The templates, by package; each is the sentence and the fix."""

    # Any value
    NO_SUCH_FILE = ("no such file", "{fix}")
    IS_MISSING = ("missing", "{fix}")
    TWICE_IN_LIST = ("has {value} twice", "keep one")
    TOO_MANY_PROBLEMS = ("more problems follow", "fix these first")

    # Pictures, videos, maps and backends
    FOLDER_FOR_PICTURE = ("is a folder", "name a picture in it")
    PICTURE_FORBIDDEN = ("may not be read", "change its permissions")
    NOT_A_PICTURE = ("is not a picture that can be read", "save it as PNG or JPEG")
    PICTURE_UNUSUAL = ("is {kind}, which is not read", "save it as PNG of 8 or 16 bits")
    MAP_COLOURS = ("are too many for a label map", "give each object one colour")
    NOT_PHOTO_SIZE = (
        "differs from the photo's {width} x {height} px",
        "make it the photo's size",
    )
    OUTPUT_IS_FILE = ("is a file", "name a folder that can be written")
    OUTPUT_UNWRITABLE = (
        "cannot be written: {reason}",
        "name a folder that can be written",
    )
    WRONG_OPTION = ("{reason}", "{fix}")
    TAKES_NO_WEIGHTS = (
        "has weights, but the backend takes none",
        "write {role}={name}",
    )
    WEIGHTS_EMPTY = ("has nothing after the colon", "write {role}={name}:PATH")
    UNKNOWN_TABLE = ("is not a key of physgen.toml", "{fix}")
    CONFIGURATION_UNREADABLE = ("cannot be read ({reason})", "see --config")
    NOT_TOML = ("is not TOML: {reason}", "see docs/models.md for an example")

    NAME_NOT_UTF8 = (
        "has a name that is not UTF-8",
        "rename it, for example to photo.png",
    )
    MAP_TRANSPARENT = ("is transparent everywhere", "save it with the objects opaque")
    MAP_LOSSY = (
        "is {format}, whose compression changes ids",
        "save it as PNG, without smoothing",
    )
    MAP_LAYERS = ("has {count} layers or frames", "save it as one flat PNG")
    MAP_ONE_CHANNEL = ("has one channel in place of three", "save it in colour")
    AVIF_UNREADABLE = (
        "is an AVIF picture, which this build of Pillow does not read",
        'pip install "pillow>=11.3"',
    )
    PHONE_FORMAT_UNREADABLE = (
        "is a {format} picture, which needs {package}",
        "{install}",
    )
    PICTURE_DAMAGED = (
        "is not a picture that can be read ({reason})",
        "save it as PNG or JPEG",
    )
    PICTURE_HIGH_RANGE = (
        "is a picture of high dynamic range",
        "tone-map it to standard range first",
    )
    UNKNOWN_OPTION = ("is not a key of this table", "{fix}")
    UNKNOWN_ROLE = ("is not a role", "{fix}")
    UNKNOWN_BACKEND = ("is not a backend", "{fix}")
    PACKAGES_MISSING = ("needs {packages}, which {verb} not installed", "{install}")
    CHOICE_WITHOUT_ROLE = ("is not ROLE=NAME", "write e.g. inpaint=fill")
    SWITCH_NOT_TEXT = ("is not text", "write text")
    UNKNOWN_DEVICE = ("is not a device", "write auto, cpu, cuda, cuda:1 or mps")
    UNKNOWN_NUMBER_FORMAT = ("is not a number format", "{fix}")
    UNKNOWN_PROFILE = ("is not a profile", "{fix}")
    CHOICE_NOT_TEXT = ("is not text", 'write e.g. depth = "marigold" below [backend]')
    NEEDS_DEPTH = (
        "needs depth",
        "choose one for depth, too: depth=marigold, or depth=file:PATH",
    )
    BACKEND_FAILED = ("failed ({error})", "see what failed, or choose another")
    VIDEO_UNREADABLE = (
        "is not a video that can be read ({reason})",
        CONVERT,
    )
    VIDEO_WITHOUT_PICTURES = ("has no moving picture", "name a video")
    FRAME_DAMAGED = (
        "cannot be decoded ({reason})",
        CONVERT,
    )
    VIDEO_HIGH_RANGE = (
        "is a video of high dynamic range",
        "tone-map it to standard range first",
    )
    FRAME_SIZE = (
        "differs from the {width} x {height} px of the first frame",
        "make all frames the same size",
    )
    VIDEO_EMPTY = ("has no frame", "name a video that shows something")
    FOLDER_WITHOUT_PICTURES = (
        "has no pictures",
        "name a folder with one picture per frame",
    )
    PAGE_DAMAGED = (
        "cannot be decoded",
        CONVERT,
    )
    # YAML
    NUMBER_TOO_LARGE = (
        "is too large a number",
        "write a finite number, at most 1.0e308",
    )
    NUMBER_NOT_FINITE = ("is not a finite number", "write a finite number")
    NUMBER_TOO_LONG = ("is a number of {length} characters", "write at most {most}")
    PICTURE_FOR_SCENE = (
        "is a picture, not a scene file",
        "make a scene of it with physgen perceive",
    )
    ZIP_FOR_SCENE = ("is a zip, not a scene file", "unzip it")
    NOT_UTF8 = ("not UTF-8 text", "save the file as UTF-8")
    FILE_EMPTY = (
        "the file is empty",
        "start with {start}",
    )
    SCENE_EMPTY = (
        "the file is empty",
        "start with {start}; if `> FILE` emptied it: --refresh writes into the scene "
        "without >",
    )
    TOP_NOT_MAPPING = ("{found}, not a mapping", "start with {start}")
    SECOND_DOCUMENT = ("a second document", "write one scene per file")
    KEY_NOT_TEXT = ("a key that is not text", "write a name before the colon")
    KEY_TWICE = ("is written twice{first}", "keep one")
    MERGE_KEY = ("a merge key `<<`", "use extends or variants")
    TAG = ("a tag, {tag}", "write plain values")
    ANCHOR = (
        "{kind}, {name}",
        "write the value itself, or use extends or variants",
    )
    NOT_YAML = ("not YAML: {reason}", "{fix}")

    # Files that a scene names
    NOT_IN_PATH = (
        "has a character that no path can have",
        "write the name of a file",
    )
    PATH_ABSOLUTE = (
        "is an absolute path",
        "keep it below {folder}, or use --allow-outside",
    )
    PATH_BROKEN = ("cannot be followed", "write the name of a file")
    PATH_OUTSIDE = (
        "leads out of {folder}",
        "keep it below {folder}, or use --allow-outside",
    )
    IS_PIPE = ("is a pipe", "name a file; what a program writes is read as /dev/stdin")
    IS_FOLDER = ("is a folder", "name a scene file in it, e.g. scene.yaml")
    CANNOT_READ = ("cannot be read: {reason}", "name a file that can be read")
    EXTENDS_NOT_PATH = (
        "is not a path",
        "write another scene file, e.g. ../pool/scene.yaml",
    )
    NOT_SCENE_FILE = ("is not a scene file", "name a .yaml file")
    EXTENDS_ITSELF = ("extends itself", "remove one of the two extends")
    DOES_NOT_EXIST = ("does not exist", "{fix}")
    EXTENDS_NOT_FILE = (
        "is not a file",
        "write the path of a scene file, relative to this one",
    )
    PICTURE_TURNED = (
        "is rotated by its EXIF data alone",
        "save it upright, or let physgen perceive make the scene",
    )
    ASSETS_NOT_FOLDER = ("is not a folder", "{fix}")
    PHOTO_CHANGED = (
        "is {size} px, but this scene was made from {perceived} px",
        "restore the photo, or perceive it again",
    )
    MAP_SIZE = ("is {size}, the canvas {canvas}", "make them the same size")
    OUTLINES_UNREADABLE = (
        "cannot be read: {reason}",
        "remove it, and outlines are fitted",
    )
    OUTLINE_MISSING = ("has no outline at {key}", "remove it, and outlines are fitted")
    ASSETS_WITHOUT_MASKS = (
        "has no masks.png",
        "restore the folder of masks.png, or perceive the photo again",
    )
    NO_ASSETS = (
        "is an id, but the scene names no assets",
        "write assets: and the folder of masks.png, or mask: {{polygon: [[x, y], ...]}}",
    )
    MASK_TAKEN = ("is the mask of {owner} already", "give each an id of its own")

    # Variants and --set
    UNKNOWN_VARIANT = ("is not a variant", "{fix}")
    SET_INCOMPLETE = (
        "has no {part}",
        "write --set KEY=VALUE, e.g. --set objects.ball.mass=200",
    )
    NOT_DOTTED_KEY = (
        "{key} is not a dotted key",
        "write keys joined by dots, e.g. objects.ball.mass",
    )
    KEY_SEALED = ("{key} cannot be set", "write it in the scene file")
    KEY_OF_OBJECTS = (
        "{key} is not a key of the scene",
        'did you mean "objects.{rest}"?',
    )
    STAR_MATCHES_NOTHING = ("* matches no key of {owner}", "name a key that exists")
    NOTHING_TO_REMOVE = (
        "{path} cannot be removed: the scene does not have it",
        "{fix}",
    )
    NO_OBJECT_CALLED = ("no object is called {name}", "{fix}")
    NOT_A_LIST = ("{path} is not a list", "write {whole}=[...] to set all of it")
    INDEX_TOO_LARGE = ("{path} has {items}", "count from 0")

    # Values of a scene
    WRONG_TYPE = ("is not {kind}", "{fix}")
    NO_WAY_FITS = ("does not fit here", "write {ways}")
    UNKNOWN_VERSION = ("is not a version that this physgen reads", "write {version}")
    UNKNOWN_WORD = ("is not allowed here", "{fix}")
    UNKNOWN_CHOICE = ("is not one of {choices}", "{fix}")
    OUT_OF_RANGE = ("is {side} {bound}", "{fix}")
    TEXT_TOO_LONG = ("is {length} characters long", "write at most {most}")
    TEXT_EMPTY = ("is empty", "write text{example}")
    NOT_A_NAME = ("is not a name", "{fix}")
    LIST_LENGTH = ("has {items}", "{fix}")
    TOO_MANY_KEYS = ("has {count:,} keys", "write at most {most:,}")
    NOT_ONE_KEY = ("{content}", "write exactly one of {kinds}")
    UNKNOWN_KEY = ("unknown key", "{fix}")

    # Rules between the keys of a scene
    EXCLUDES = ("cannot be combined with {other}", "write only one of the two")
    NO_CANVAS = (
        "missing",
        "write image: photo.png, or size: [512, 512] for a scene without a photo",
    )
    NO_MASK_NOR_SHAPE = ("has neither mask nor shape", "{fix}")
    NO_MASK_FOR_SHAPE = ("has a shape to fit, but no mask", "{fix}")
    SOLID_NEEDS_CIRCLE = ("is not possible with a {kind}", "write plate")
    OUTLINE_CROSSES = (
        "crosses itself: the lines from corners {first} and {second}",
        "write the corners in order",
    )
    OUTLINE_FLAT = (
        "has no area",
        "write at least three corners that are not on one line",
    )
    OUTLINE_SMALL = (
        "has an area of {area:.2g} px², below {least:g} px²",
        "draw it larger; did you mean meters? write each number as e.g. 0.5 m",
    )
    SHAPE_HUGE = (
        "is {extent:,.0f} px long, above {longest:,} px",
        "write at most {times} times the photo's longer side; did you mean px? write "
        "the numbers without a unit",
    )
    HOLE_OUTSIDE = ("leads out of its outline", "keep holes inside")
    PATH_START = ("is not 0", "start the path at time 0")
    TIMES_NOT_RISING = ("is not after {before}", "write {items} with rising times")
    NO_LINE = (
        "has no line",
        "write segment: [[0, 457], [512, 457]], polyline or mask",
    )
    SEVERAL_LINES = ("has {keys}", "write only one of them")
    POINT_REPEATED = ("repeats the point before it", "move or remove it")
    JOINED_TO_ITSELF = (
        "is joined to itself",
        "name two objects, or one to hold it to the world",
    )
    UNKNOWN_OBJECT = ("is not an object of this scene", "{fix}")
    KEY_NEEDED = ("missing, but {kind} needs it", "{fix}")
    KEY_OF_OTHER_KIND = ("is only for {owner}, and this is {kind}", "remove it")
    TORQUE_WITH_POINT = (
        "has no effect: a torque turns the body as a whole",
        "remove it",
    )
    IMPULSE_WITH_DURATION = ("has no effect: an impulse takes no time", "remove it")
    VIDEO_TOO_LARGE = (
        "makes a video of {width} x {height}, which {limit}",
        "write at most {most:g}",
    )
    POINT_OUTSIDE = (
        "is outside the photo, which is {width} x {height}",
        "write a point in it, e.g. [{x}, {y}]",
    )
    UNKNOWN_REFINER = ("is not a backend for refinement", "{fix}")
    NO_STEP = (
        "leaves none of {steps} steps to run",
        "write at least {least}, or backend: none",
    )
    DIRECTION_ZERO = ("has no length", "{fix}")
    RANGE_ORDER = ("has the larger number first", "write the smaller number first")

    # The YAML of the editor
    EDITOR_UNREADABLE = (
        "the file cannot be read{where}: {reason}",
        "correct the YAML, or undo",
    )
    EDITOR_NOT_THERE = ("{path} is not there", "ask for the state and edit again")
    EDITOR_UNWRITABLE = (
        "the YAML is written in a form that edits cannot change",
        "edit the YAML beside",
    )
    # End of the templates

    def __init__(self, expected: str, fix: str) -> None:
        self._expected, self._fix = expected, fix

    @property
    def code(self) -> str:
        """Name of the template in problems: `no-such-file`."""
        return self.name.lower().replace("_", "-")

    @property
    def fields(self) -> frozenset[str]:
        """Names of the values that the sentence and the fix contain."""
        parts = Formatter().parse(self._expected + self._fix)
        return frozenset(name for _, name, _, _ in parts if name)

    def refusal(self, **values: object) -> RefusedError:
        """Return the refusal of a value whose place its caller knows."""
        expected = self._expected.format(**values)
        return RefusedError(expected, self._fix.format(**values), self.code)

    def problem(
        self,
        place: Place,
        path: str | KeyPath = "",
        found: str = "",
        /,
        **values: object,
    ) -> Problem:
        """Return the problem of a value at its place."""
        where = path if isinstance(path, str) else dotted(path)
        return self.refusal(**values).problem(place, where, found)

    def warning(
        self,
        place: Place,
        path: str | KeyPath = "",
        found: str = "",
        /,
        **values: object,
    ) -> Problem:
        """Return the warning about a value at its place."""
        where = path if isinstance(path, str) else dotted(path)
        refusal = self.refusal(**values)
        return refusal.problem(place, where, found, Severity.WARNING)

    def error(self, file: str, found: str = "", /, **values: object) -> InputError:
        """Return the error of one problem with a whole file or a flag."""
        return InputError([self.problem(Place(file), "", found, **values)])

    def error_at(
        self,
        place: Place,
        path: str | KeyPath = "",
        found: str = "",
        /,
        **values: object,
    ) -> InputError:
        """Return the error of one problem with a value at its place."""
        return InputError([self.problem(place, path, found, **values)])

    def impossible(self, **values: object) -> EditError:
        """Return the error of an edit that this scene does not allow."""
        refusal = self.refusal(**values)
        return EditError(Why.IMPOSSIBLE, refusal.expected, refusal.fix)
