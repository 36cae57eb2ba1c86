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
from dataclasses import replace
from enum import Enum, unique
from string import Formatter

from physgen.problems import (
    EditError,
    EditRefusal,
    InputError,
    Place,
    Problem,
    RefusedError,
    Severity,
)
from physgen.text import KeyPath, dotted, listed, nearest, quoted


def did_you_mean(name: str) -> str:
    """Return the fix that asks for a similar name.

    >>> did_you_mean("ball")
    'did you mean "ball"?'
    """
    return f"did you mean {quoted(name)}?"


def one_of(name: str, names: Sequence[str]) -> str:
    """Return the fix of an unknown name: a similar one, or the names that exist.

    >>> one_of("bal", ["ball", "cup"]), one_of("moon", ["ball", "cup"])
    ('did you mean "ball"?', 'write ball or cup')
    """
    similar = nearest(name, names)
    if similar:
        return did_you_mean(similar)
    return f"write {listed(names[:MOST_NAMES])}"


CONVERT = "save it as MP4, GIF or WebP, or as a folder of PNG"
"""What to do about a video that cannot be read."""
MOST_NAMES = 30
"""Names that a fix lists; a reader looks up longer lists in the documentation."""


@unique
class Note(Enum):
    """Sentences of summaries and doubts, which are no problems of an input."""

    # Doubts about a photo
    FEW_SURE_OBJECTS = "few sure objects"
    MAY_BE_OBJECTS = "{share} of the photo may be objects, too"
    NO_LOOSE_OBJECTS = "it looks like a photo without loose objects at rest"
    IMMOVABLE = "{share} of the photo looks immovable"
    LIKE_SKY = "{share} of the background is blue like the sky"
    LIKE_FOLIAGE = "{share} of the background looks like leaves or grass"
    CLUTTERED = "{share} of the background is cluttered"
    MARKED_IMMOVABLE = "the marked object looks immovable"
    MARKED_FAINT = "the marked object hardly stands out"
    FILLS_PHOTO = "one object fills {share} of the photo"
    NO_SUPPORT = "no support is visible beneath {count} of {objects}"
    VIEW_UNCERTAIN = "the view is uncertain: from the side or from above"

    # Doubts about the motion of a clip
    PUSH_MOVES_NOTHING = "the push of {names} moves nothing visibly"
    REBOUNDS = "{names} would rebound from a wall that the photo does not show"
    LEAVES_PICTURE = "{names} leaves the picture, also at the gentlest push"
    GUESSED_FLOOR = "{name} is pushed on a guessed floor: it is unsure what carries it"
    PART_MAY_STAY = "a part of {names} may stay behind"
    RESTLESS = "something moves for too long, or climbs an obstacle"
    MOTION_BRIEF = "the motion takes only {seconds:.1f} s of video"
    MUCH_FILLED = "{share} of the photo must be filled in behind moving objects"
    BUSY_FILLED = "{share} of the photo must be filled in behind moving objects, beside fine detail"
    NOTHING_MOVES = "no push moves anything"
    CUT_BY_BORDER = (
        "no push moves anything: {names} {verb} cut off by the photo's border"
    )
    LIVING = "{names}: {kinds}, never pushed"
    LIVING_OR_TOY = (
        '{names}: {kinds}, never pushed; if it is a toy, label it "toy {noun}"'
    )
    TAKEN_FOR_TOY = "{names} {verb}"

    # The summary of a perceived photo
    NO_OBJECTS = "none; {fix}"
    SCALE = (
        "{scale:g} px/m, {reason}; to correct it, name an object by --label, or set "
        "world.pixels_per_meter"
    )
    NO_BOUNDARY = "no boundary is visible"
    STATIC = "{boundaries}; held where they are: {names}"
    PUSHED = "{name} is pushed {way}"
    NOTHING_PUSHED = "nothing is pushed"
    UNSURE = "unsure {names}: not an object? move it to doubtful, as {{mask: N}}"
    ONE_REGION = "1 region may be an object, too: to use one, move {name} to objects"
    SEVERAL_REGIONS = (
        "{count} regions may be objects, too: to use one, move {name} ... to objects"
    )

    # A story that a model tells
    STORY_SCRIPTED = "{name} follows a path, and cannot be pushed"
    STORY_FROM_ABOVE = "nothing can be dropped in a scene seen from above"
    STORY_NAME_TAKEN = "{name} is an object already; give the new one another name"
    STORY_NOTHING_MOVES = "nothing moves"

    # Reports of files
    BACKUP = "the previous {name} is kept as {backup}"
    EDITED = "{edit}; backup: {backup}"

    @property
    def fields(self) -> frozenset[str]:
        """Names of the values that the sentence contains."""
        return _fields(self.value)

    def text(self, **values: object) -> str:
        """Return the sentence.

        >>> Note.IMMOVABLE.text(share="8 %")
        '8 % of the photo looks immovable'
        """
        return str(self.value).format(**values)


def _fields(template: str) -> frozenset[str]:
    """Return the names of the fields of a template."""
    return frozenset(name for _, name, _, _ in Formatter().parse(template) if name)


@unique
class Message(Enum):
    """The templates, by package; each is the sentence and the fix."""

    # Any value
    NO_SUCH_FILE = ("no such file", "{fix}")
    IS_MISSING = ("missing", "{fix}")
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

    # Flags and arguments of the command line
    OUTPUT_NAME_EMPTY = ("is not a name", "write the path of a new file or folder")
    OUTPUT_NAME_LONG = ("has a name of {length} bytes", "write at most {most}")
    NOT_WHOLE_NUMBER = ("is not a whole number", "write one from {low} to {high}")
    NOT_ABOVE_ZERO = ("is not a number above 0", "write one up to {most:,.0f}")
    NOT_AMONG = ("is not among the choices", "write some of {names}")
    NOT_NUMBERS = ("is not a list of numbers", "write e.g. 1,5,12")
    NOT_SPEEDS = (
        "is not a list of 2 to {most} different speeds",
        "write e.g. 50,100,200",
    )
    NOT_A_CLUSTER = (
        "is not a cluster",
        "write tcp://HOST:8786, a scheduler's FILE.json, or local:4",
    )
    NOT_A_PART = ("is not a part", "write e.g. 2/8, the second of 8 machines")
    UNKNOWN_FLAG = ("is not a flag", "{fix}")
    ARGUMENT_TOO_MANY = ("is one argument too many", "{fix}")
    KEY_WITHOUT_SET = ("is not a file", "to set the key, write --set {setting}")

    # Batches
    DRAWS_WITHOUT_COUNT = (
        "is a distribution without a number of draws",
        "add e.g. --samples 100",
    )
    NOTHING_TO_DRAW = (
        "has nothing to draw",
        "give a key a distribution, e.g. 'objects.ball.mass=~uniform(100, 200)'",
    )
    NO_KEYS_TO_SWEEP = (
        "has no keys to vary",
        "write e.g. objects.ball.mass=100:900:9, or --variant all",
    )
    TOO_MANY_CLIPS = (
        "{product} are {count:,} clips",
        "make at most {most:,}; draws (KEY=~uniform(a, b) --samples N) cover many "
        "keys with few",
    )
    IN_STORE_ALREADY = (
        "is already in {url}",
        "choose another folder with -o, or remove it",
    )

    # Evaluation
    NO_SUCH_PATH = ("no such file or folder", "check the path")
    CLIP_SHAPES_DIFFER = (
        "is {aspect:.3g} times as wide as high, and {other} {other_aspect:.3g} times",
        "crop the clips to one shape",
    )
    MOTION_PICTURES_TOO_FEW = (
        "make fewer than two pictures of motion",
        "name more clips, of two frames or more",
    )
    FEATURES_NOT_FINITE = ("gives numbers that are not finite", "name another file")
    PICTURES_TOO_FEW = (
        "are too few for {features} features: the Fréchet distance is too large ({kind})",
        "compare equal numbers",
    )
    CLIP_LENGTHS_DIFFER = (
        "differ from the reference's {length:g}: flow is over other times",
        "give --frames {frames:g}",
    )
    MANIFEST_UNREADABLE = ("cannot be read", "make the clip again: physgen render")
    STAGE_TIMES_MISSING = (
        "has no times of its stages",
        "make the clip again: physgen render",
    )
    FOLDERS_WITHOUT_CLIPS = (
        "has no clips",
        "name folders that physgen render or sweep made",
    )
    MAP_IN_CHECK = (
        "names a map, which belongs to its own photo",
        "write {reader} to check the reader",
    )
    FOLDER_WITHOUT_VIDEOS = (
        "has no clips",
        "name a folder of videos, or of folders of frames",
    )
    CLIP_WITHOUT_FRAMES = ("has no frame after the first {skip}", "leave it out")
    FRAMES_TOO_FEW = (
        "are fewer than --frames {wanted}",
        "give --frames {count}, or leave the clip out",
    )
    UNKNOWN_ROW = ("is not a row", "choose from 1 to {last}")
    METHODS_NOT_FOLDER = (
        "is not a folder",
        "name a folder with a folder for each method",
    )
    NO_METHODS = (
        "has no methods",
        "put clips at METHOD/SCENE.mp4 or METHOD/SCENE/video.mp4 in it",
    )
    CLIP_FOR_METHOD = (
        "is a clip, not a method",
        "name the folder above it, with a folder for each method",
    )
    TWO_CLIPS_OF_SCENE = ('are two clips of the scene "{scene}"', "leave one there")
    VIDEO_OF_ONE_FRAME = (
        "has one frame, so it is not a video",
        "make at least two frames",
    )
    VIDEO_WITHOUT_RATE = ("has no frame rate", "save it as MP4")
    STUDY_KEY_CHANGED = (
        "is a key that was changed: parts are missing or do not fit",
        "use the file as it was made",
    )
    NOT_STUDY_KEY = (
        "is not the key of a study",
        "name the NAME.key.json that was made with the page, with --key",
    )
    NOT_STUDY_ANSWERS = (
        "is not a rater's answers",
        "name files that the page of a study saved",
    )
    NOT_JSON = ("cannot be read as JSON", "{fix}")
    STUDY_VERSION = (
        "is not a version that this physgen reads (it reads {known})",
        "use the physgen that made it",
    )
    NO_COMMON_SCENE = (
        "have no scene in common",
        "give all methods a clip of the same scene, under the same name",
    )
    NOT_PAGE_NAME = (
        "is not a name for a page",
        "end it in .html, e.g. -o study.html",
    )
    NOTHING_TO_PUSH = ("has no object that can be pushed", "add a dynamic object")
    OBJECT_NOT_DYNAMIC = ("cannot be pushed: it is not dynamic", "{fix}")
    TABLE_UNREADABLE = (
        "cannot be read ({reason})",
        "write a table like physgen/evaluate/objects.yaml",
    )
    NOT_OBJECT_TABLE = (
        "is not a table of objects ({reason})",
        "write a table like physgen/evaluate/objects.yaml",
    )
    OBJECT_TABLE_EMPTY = (
        "has nothing to compare answers with",
        "give objects a mass in g, or write a ranking",
    )
    SIZE_OF_FORM = (
        "does not fit the form {form}",
        "write {count} lengths in mm",
    )
    OBJECT_NUMBER_NEGATIVE = (
        "has a mass or a length that is not above 0",
        "write numbers above 0",
    )
    RANKING_TOO_SHORT = (
        "are not two objects of the table or more",
        "rank two or more objects of the table",
    )
    NO_TRUTH_VIDEOS = (
        "has no truth videos",
        "name the folder studio/truth of physgen's repository",
    )
    UNKNOWN_TRUTH = ("has no truth video", "choose from {names}")
    NOT_INCEPTION = ("is another network: {reason}", "{fix}")
    UNKNOWN_BODIES = ("is not among the bodies", "write {names}")
    NOT_TRACKS = (
        "is not a kind of tracks",
        "name a clip's folder, a scene file, or a CSV of frame,name,x,y",
    )
    TRAJECTORY_UNREADABLE = ("cannot be read: {reason}", "render the clip again")
    TRACKS_SIZE = (
        "are too few frames or too many cells",
        "give 2 frames or more, up to {most:,} cells",
    )
    BODY_TWICE_IN_FRAME = (
        "is twice in frame {frame:g}",
        "give each body its own name",
    )
    CSV_UNREADABLE = (
        "cannot be read as CSV: {reason}",
        "save it as UTF-8 with commas",
    )
    CSV_COLUMNS_MISSING = (
        "do not include {names}",
        "begin with frame,name,x,y,radius",
    )
    NO_TRACKS = ("has no tracks", "write one line for each frame and body")
    NOT_TRACK_NUMBER = (
        "is not a {kind} from {low:g} to {high:g}",
        "write px, and count frames",
    )
    MOTION_TOO_SHORT = (
        "are too few to judge motion",
        "give {least} frames or more",
    )
    RATER_TWICE = (
        "has other answers in {file}",
        'leave one file out, or change "rater" in one if they are two people',
    )
    NO_ANSWERS = (
        "has no answer to any question",
        "rate clips on the page, then save",
    )
    OTHER_STUDY = (
        'is another study than the key\'s "{study}"',
        "name the key of this study with --key",
    )
    ANSWERS_INCOMPLETE = ("has no rater or no answers", "save the page again")
    NOT_STUDY_CLIP = ("is not a clip of this study with answers", "leave it out")
    NOT_A_SCORE = (
        "is not a score from 1 to {most}",
        "write a whole number, or leave it out",
    )
    PHOTOS_NOT_FOLDER = ("is not a folder", "name the folder of the photos")
    NO_LABELLED_PHOTO = ("has no photo with a label map", "{fix}")
    LABELS_WITHOUT_PHOTO = ("has no photo", "give photo and label map the same name")
    PHOTO_WITHOUT_LABELS = ("is left out: it has no label map", "{fix}")
    LABELS_OF_TWO_PHOTOS = ("could both be its photo", "keep one of them")

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

    DECIMAL_COMMA = ("has a decimal comma", "write a point: {number}")

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
        "write segment: [[0, 457], [512, 457]], polyline, arc, bezier, shape or mask",
    )
    SEVERAL_LINES = ("has {keys}", "write only one of them")
    POINT_REPEATED = ("repeats the point before it", "move or remove it")
    JOINED_TO_ITSELF = (
        "is joined to itself",
        "name two objects, or one to hold it to the world",
    )
    UNKNOWN_OBJECT = ("is not an object of this scene", "{fix}")
    KEY_NEEDED = ("missing, but {kind} needs it", "{fix}")
    HAS_NO_EFFECT = ("has no effect here: {why}", "remove it")
    LOOP_OPEN = (
        "does not end where it began, although it starts again",
        "end with [{time:g}, {x:g}, {y:g}]",
    )
    CURVE_POINTS = (
        "has {count} points",
        "write one point, then three for each curve: 4, 7, 10, ...",
    )
    ARC_ANGLES = ("{fault}", "write angles at most 360 degrees apart")
    ONE_WAY_ZERO = (
        "has no direction",
        "write e.g. [0, -1]: others pass upwards",
    )
    UNKNOWN_GROUP = ("is not a collision_group of this scene", "{fix}")
    TOO_MANY_GROUPS = ("are more than {most}", "join some of them")
    STATIC_FRICTION_LOW = (
        "is less than the friction while it slides, {friction}",
        "write a larger value, or a smaller friction",
    )
    NAMED_TWICE = ("names an object twice", "remove one")
    TIME_NEGATIVE = ("is below 0", "write {items} with rising times")
    FINGER_ON_TWO = ("are two, but a finger pulls one", "name one object")
    GEAR_ON_ONE = (
        "is one object, but a gear turns two",
        "name two, each on its own pin",
    )
    GEAR_ZERO = (
        "turns nothing",
        "write e.g. -2: the first turns twice as fast, the other way",
    )
    SAME_ENDS = ("has two points at the same place", "move one")
    OFF_RAIL = (
        "ends {away:.1f} px before {object}",
        "move the object onto the rail, or end the rail at [{x:.4g}, {y:.4g}] or later",
    )
    FORCE_WITHOUT_DRIVE = ("missing, but its force needs it", "{fix}")
    ROPE_SHORT = (
        "is less than the {least:.6g} px between its points",
        "lengthen it, or move its ends",
    )
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

    # Warnings of a scene
    CARRIES_NOTHING = (
        "carries nothing: it needs a view from above and friction of the table",
        "write view: top and table: {{friction: 0.3}}, or remove it",
    )
    TABLE_FROM_SIDE = (
        "has no effect seen from the side",
        "remove it, or write view: top",
    )
    NO_EFFECT_ON_MOTION = (
        "has no effect on an object whose motion is {motion}",
        "remove it, or write motion: dynamic",
    )
    WHEELS_FROM_ABOVE = ("have no effect seen from above", "remove them")
    ROLLING_HAS_NO_EFFECT = ("has no effect: only {shapes} roll", "remove it")
    ROCKING_HAS_NO_EFFECT = (
        "has no effect: only dynamic objects with corners, seen from the side, rock",
        "remove it",
    )
    ROLL_HAS_NO_EFFECT = (
        "has no effect: only dynamic spheres on a tabletop with friction roll",
        "remove it",
    )
    FORCE_HAS_NO_EFFECT = (
        "has no effect: the motion of {name} is {motion}",
        "remove it, or write motion: dynamic",
    )
    NOTHING_TO_STRIKE = (
        "has no effect: {why}",
        "remove it, or give an object in a photo a velocity or an impulse",
    )
    FORCE_AFTER_END = (
        "begins after the end of the clip at {end:g} s",
        "begin earlier or lengthen the duration",
    )
    GEAR_WITHOUT_PIN = (
        "turns {names} without a pin: only the turning is coupled",
        "hold each of the two by a pivot",
    )
    MOVES_NO_OBJECT = (
        "has no effect: none of its objects is dynamic",
        "remove it, or write motion: dynamic",
    )
    JOINTS_EXCLUDE_START = (
        "is not possible with the joints of the object",
        "write velocity: [{x:.4g}, {y:.4g}] and spin: {spin:.4g}, with which it starts",
    )
    GRAVITY_WEAK = (
        "px/s² is {strength:.2g} m/s², in which objects float",
        "did you mean m/s²? write [{x:g} m/s², {y:g} m/s²]",
    )
    STEPS_COARSE = (
        "steps a second are too few: gravity moves objects by {fall:.2g} px in a step, "
        "in which stacks sink or fall",
        "write {steps} or more, or a smaller world.pixels_per_meter",
    )
    SCALE_TOO_FINE = (
        "steps a second are too few: gravity moves objects by {fall:.2g} px in a step, "
        "in which stacks sink or fall",
        "write a smaller world.pixels_per_meter",
    )
    SHAPE_INVISIBLE = (
        "is smaller than a pixel and is not visible",
        "sizes are in pixels; did you mean meters? write e.g. 0.5 m",
    )
    SCALE_CHANGED = (
        "is not the perceived {perceived:g} px/m, on which masses, pushes and playback "
        "depend",
        "perceive --refresh writes them",
    )
    SCALE_OF_NEW_LABELS = (
        "is the scale by the changed labels, not the {perceived:g} px/m of this line",
        "perceive --refresh writes it",
    )
    LABEL_CHANGED = (
        "is not the perceived label, and gives {values}",
        "perceive --refresh writes them",
    )
    CLIP_LONG = (
        "makes {frames:,} frames, {length:.3g} min of video, in about {minutes:.2g} min",
        "write auto, which ends the clip after all rest, or try --preview first",
    )
    VIEW_AT_BORDER = (
        "is too near the photo's border for zoom {zoom:g}: the view stops at "
        "[{x:g}, {y:g}]",
        "zoom in further, or move the center there",
    )
    VIEW_AFTER_END = (
        "is after the end of the motion at {end:g} s: this view is never reached",
        "make it earlier, or lengthen the duration",
    )
    PHOTO_EDITED = (
        "differs from background.png in {count:,} px beside the objects ({place}), "
        "but the clip shows background.png",
        "if the photo was edited, physgen perceive --refresh makes the maps again",
    )
    DOUBTFUL_IS_OBJECT = (
        "is the mask of the object {name}",
        "delete this entry, or objects.{name}",
    )
    DOUBTFUL_ID_MISSING = (
        "is not an id in masks.png",
        "write the mask that the object had",
    )
    SHAPE_MISSES_MASK = ("misses {share} of its mask", "{fix}")
    SHAPE_BEYOND_MASK = ("reaches {share} beyond its mask", "{fix}")
    OVERLAP_AT_START = (
        "overlaps {other} by {depth:.1f} px at t = 0",
        "move or shrink one of them, or they are pushed apart",
    )
    ACROSS_BOUNDARY = (
        "reaches {depth:.1f} px across boundary {name} at t = 0",
        "move the boundary or the object",
    )
    MORE_OVERLAPS = (
        "are so near that they may overlap, too",
        "move or shrink one of them, or they are pushed apart",
    )
    UNSUPPORTED = (
        "is supported by nothing and falls at once",
        "put a boundary under it, hold it with a joint, or write motion: static",
    )

    # Simulation and refinement
    TOO_MANY_SAMPLES = (
        "from duration times fps{slow} are too many",
        "write render.frames, {most}, or a smaller {keys}",
    )
    MASK_OF_NO_PIXEL = (
        "covers no pixel",
        "write an id of masks.png, or an outline inside the photo",
    )
    ID_WITHOUT_PHOTO = (
        "is an id, but the scene has no photo and so no masks.png",
        "write image: photo.png, or an outline",
    )
    MOTION_DIVERGED = (
        "becomes larger than any number by t = {time:.3f} s",
        "raise steps_per_second, or look for a force, spring or joint that is too "
        "strong for its mass",
    )

    MASS_TOO_LARGE = (
        "and a moment of inertia of {moment:.2g} g·px² cannot be simulated",
        "make it lighter or smaller",
    )
    MASS_TOO_SMALL = (
        "and a moment of inertia of {moment:.2g} g·px² cannot be simulated",
        "make it heavier or larger",
    )
    MASSES_FAR_APART = (
        "masses 10^9 apart or more cannot be simulated together",
        "bring them nearer",
    )
    OUTLINE_UNUSABLE = ("{reason}", "draw it with a larger area")
    KNOT_ELSEWHERE = ("is not at the object", "begin with [{time:g}, {x:.2f}, {y:.2f}]")
    HIDDEN_BY_MASKS = (
        "is hidden behind the masks of others",
        "write its shape, or give it a layer in front of theirs",
    )
    WHEELS_ON_CIRCLE = (
        "are on an object that is a circle and rolls itself",
        "remove wheels, or write its shape as a polygon",
    )
    WHEEL_TWICE = ("is written twice", "remove one of them")
    WHEEL_FAR = (
        (
            "is {distance:.0f} px from the object, which is at x {x0:.0f} to "
            "{x1:.0f}, y {y0:.0f} to {y1:.0f}"
        ),
        "write a center inside it",
    )
    NOT_AN_ADAPTER = (
        "is a {kind}, not a motion adapter",
        "name a motion adapter first, e.g. {example}",
    )
    BASE_DOES_NOT_FIT = (
        "is a {kind} that the adapter does not fit",
        "name weights of Stable Diffusion 1.5 after the comma",
    )
    WEIGHTS_RUN_CODE = (
        "would run {kind} for its {part}",
        "name weights of plain parts",
    )
    WRONG_WEIGHTS = (
        "is a {kind}: not for {purpose}",
        "name weights of a {known}, or the backend of these",
    )
    TOO_MANY_FRAMES = (
        "is more than the {most} frames that the model can see",
        "write at most {most}",
    )
    REFINED_NOT_FINITE = (
        "gives no finite picture",
        'write dtype = "float32" in physgen.toml',
    )
    REFINING_TOO_LARGE = (
        "do not fit into the memory of the device",
        (
            "write a smaller resolution in the backend's section of physgen.toml, "
            "or refine fewer frames"
        ),
    )
    REFINER_FAILED = ("failed ({error})", "see what failed, or choose another backend")
    SPRING_TOO_STIFF = (
        "needs every step divided into {parts:,} parts",
        (
            "make it softer, the objects on it heavier, or steps_per_second larger:"
            " at most {most_parts} parts"
        ),
    )
    # The editor
    EDIT_MAKES_PROBLEM = ("after this edit, {reason}", "{fix}")
    MARK_REFUSED = ("the marked part {reason}", "{fix}")

    NO_SUCH_VARIANT = ("the scene has no variant {name}", "choose one of its variants")
    PORT_UNUSABLE = (
        "cannot be listened on: {reason}",
        "leave it out, and a free port of this machine is taken",
    )
    NOTHING_LEFT = (
        "no pixel would be left of {name}",
        "delete it first, or merge the two",
    )
    NO_ID_LEFT = ("the label map has no id left", "merge objects, or delete some")
    DRAFT_IMPOSSIBLE = (
        "cannot have a draft beside it: {reason}",
        "copy the scene to a folder that you may write to",
    )
    DRAFT_STRANGE = ("{fault}", "move the folder, or remove it")
    NAME_UNKNOWN = ("no object is called {name!r}", "choose an object")
    OPERATION_MALFORMED = ("{reason}", "see docs/editor.md")
    STROKE_CHANGES_NOTHING = ("the stroke changes nothing", "paint over its border")
    MERGE_WITH_ITSELF = ("an object is named twice", "name each object once")
    SPLIT_AT_POINT = ("the line is a point", "draw it across the object")
    MASK_TOO_SMALL = (
        "{part} would have fewer than {least} px",
        "mark more of it, or delete the object",
    )
    STROKE_TOO_LONG = ("the stroke is too long for its width", "paint it in parts")
    SCENE_HAS_ERROR = ("the scene has an error: {problem}", "correct it first")
    NO_PHOTO_TO_MASK = (
        "the scene has no photo, so there is nothing to mask",
        "draw the object's shape",
    )
    UNKNOWN_OPERATION = (
        "this operation does not exist",
        'send {{"set": [...], "value": ...}}',
    )
    UNUSABLE_VALUE = ("{reason}", "send values of scene files")
    VARIANT_SECTION_FIXED = ("a variant cannot change {path}", "edit the file itself")
    EXISTS_ALREADY = ("{path} exists already", "choose another name, or set it")
    SENT_NOT_FINITE = ("a number is not finite", "send a finite number")
    SENT_TOO_LARGE = ("a number is too large", "send a finite number")
    PART_MISSING = ("{owner} has no {key}", "set the whole of it")
    ITEM_MISSING = ("{path} does not exist", "set the whole list")
    FILE_EXTENDS = (
        "the file extends another one",
        "edit its YAML beside the photo, or that file",
    )
    VARIANT_MISSING = (
        "the scene has no variant {variant}",
        "make it first, or edit the file itself",
    )
    VARIANT_NOT_WRITABLE = (
        "variant {variant} cannot be changed in this way",
        "edit the file itself",
    )
    EDITOR_NOT_THERE = ("{path} is not there", "ask for the state and edit again")
    VARIANT_CANNOT_RENAME = ("a variant cannot rename", "rename in the file itself")
    NOT_RENAMABLE = (
        "{path} is not a name that can be changed",
        "name an object, a joint, ...",
    )
    NEW_NAME_WRONG = ("the new name is not a name", "write {form}")
    NAME_TAKEN = ("{name} exists already", "choose another name")
    NO_VARIANT_CHOSEN = ("no variant is chosen", "choose at least one")
    UNKNOWN_VIDEO_FORMAT = (
        "this format does not exist",
        "choose mp4, gif, webp or png",
    )
    NOTHING_TO_UNDO = ("there is nothing to {step}", "edit something first")
    FILE_REMOVED = ("the file was removed", "save to write it again")
    EDITOR_UNREADABLE = (
        "the file cannot be read{where}: {reason}",
        "correct the YAML, or undo",
    )
    EDITOR_UNWRITABLE = (
        "the YAML is written in a form that edits cannot change",
        "edit the YAML beside",
    )
    # Commands and their flags

    VALUE_SPLIT = (
        "has spaces, which end the value of a flag",
        'write {flag} "{value}"',
    )
    NOT_A_FOLDER_NAME = ("is not a name for a folder", "name a folder, e.g. {example}")
    NOT_A_SCENE_NAME = (
        "is not a name for a scene file",
        "end it in .yaml; without -o the scene is printed",
    )
    NOTHING_TO_CLEAN = ("does not exist", "name a scene or a folder")
    ONE_FILE_FOR_CLIPS = ("is one file for {count} clips", "name a folder")
    CLIPS_CALLED_ALIKE = (
        "would be written over {other}: both are called {name}",
        "render them into two folders",
    )
    STORE_EMPTY = ("is not a store", "write s3://BUCKET/NAME, or another URL of fsspec")
    STORE_WITHOUT_CLUSTER = ("is only for clusters", "add --cluster ADDRESS")
    JOBS_WITH_CLUSTER = (
        "is only for one machine",
        "leave it out: a cluster runs one job per worker",
    )
    DASK_MISSING = ("needs Dask, which is not installed", "{install}")
    SPLIT_EMPTY = (
        "has no clip in {empty}: {there}",
        (
            "splits are by photo: take more photos, another --seed, or other shares"
            " with --split"
        ),
    )
    EDITOR_PACKAGES_MISSING = ("needs {packages}, which is not installed", "{install}")
    MERGE_NEEDS_TWO = (
        "is one name; two or more are merged",
        "write physgen merge {path} {name}, and the parts of it",
    )
    SCENE_NOT_FIRST = (
        "is not a scene file: the scene is the first argument",
        "write physgen {command} {arguments}",
    )
    SEVERAL_NAMES_IN_ONE = (
        "is more than one name",
        "put spaces between the names: {parts}",
    )
    NAME_OF_ANOTHER_KIND = (
        "is a {kind}, not an object",
        "edit its lines in the file, or use physgen edit",
    )
    ROLE_NOT_SEGMENT = ("is not used here", "write segment=NAME")
    FRAMES_TOO_LARGE = (
        "makes frames that do not fit into memory",
        "give a smaller --size, or fewer --frames",
    )
    METHODS_CALLED_ALIKE = (
        'are equal names, or "reference"',
        "give each method's folder a name of its own",
    )
    KEY_MISSING = (
        "is missing: answers are read with it",
        "name the key that was made with the page, e.g. --key study.key.json",
    )
    SECOND_FOLDER = (
        "is a second folder",
        "name one folder with the folders of all methods",
    )
    VIDEOS_WITH_KEY = (
        "is not used to read answers",
        "leave it out, or leave --key out",
    )
    NOT_A_PAGE_NAME = ("is not a name for a page", "end it in .html, e.g. -o {example}")
    NO_PHYSGEN_CLIPS = (
        "has no clips of physgen",
        "make some: physgen render scene.yaml -o DIR",
    )
    ROLE_NOT_PHYSICS = ("is not used here", "write physics=NAME")
    VARIANT_ALL = ("names more than one variant", "write one name")
    NO_PHOTO = ("has no photo", "name one, or a scene: --refresh SCENE")
    REFRESH_NEEDS_OUTPUT = (
        "needs -o",
        "name the new scene file, which gets its maps beside it: -o NEW.yaml",
    )
    PUSH_AND_STILL = ("cannot be used with --still", "leave --push or --still out")
    SMALLEST_WITHOUT_POINT = ("is only for --point", "add --point X,Y, or leave it out")
    VIDEO_FOR_STORE = ("is a file, but clips in a store need a folder", "name a folder")
    NOT_A_VIDEO_NAME = (
        "is not a name for a video",
        "end it in {suffixes}, or name a folder",
    )
    VIDEO_AND_FORMAT = (
        "does not match --format {formats}",
        "leave --format out, or write --format {name},{formats}",
    )
    NOT_A_TRAJECTORY_NAME = (
        "is not a name for a trajectory",
        "end it in .npz, .csv or .json",
    )
    VARIANT_ALL_SIMULATED = (
        "names more than one variant",
        "write one name, or use render",
    )
    SWEEP_WITHOUT_SCENE = (
        "is not a scene file",
        "the scene comes first: physgen sweep scene.yaml KEY=VALUES",
    )
    TABLE_IS_FOLDER = (
        "has a folder sweep.csv, but the table needs that name",
        "name another",
    )
    NOT_MOVABLE = ("is not an object that can move", "{fix}")
    IN_PERCENT = ("is in percent", "{fix}")
    NOT_COORDINATES = ("is not {count} numbers", "{fix}")
    DOUBTFUL_FIRST = ("is a doubtful region, not an object", "{fix}")
    INCEPTION_NEEDS = ("needs {package}, which is not installed", "{install}")
    SCENE_FOR_PHOTO = ("is a scene file, not a photo", "{fix}")
    FLAG_OF_ONE_PHOTO = ("is for one photo", "leave it out, or name one photo")
    PHOTOS_NEED_FOLDER = ("need a folder", "name it: -o FOLDER")
    PHOTO_MISSING = ("does not exist", "name a photo")
    PHOTOS_CALLED_ALIKE = ("is the name of two photos", "rename one")
    NOT_WITH_REFRESH = (
        "cannot be used with --refresh",
        "leave {flag} or --refresh out",
    )

    # Batches and clusters
    AXIS_COVERED = (
        "replaces all of {other}",
        "keep one; several values go into one argument: {key}=VALUE,VALUE",
    )
    AXIS_WITHOUT_KEY = ("has no key", "write e.g. {example}")
    AXIS_KEY_WRONG = ("{key} is not a dotted key", "write e.g. {example}")
    FILE_KEPT = ("differed from the new one and is kept as {backup}", "")
    JOB_FAILED = ("{failure}", "{fix}")
    VALUE_NOT_YAML = ("{value}: {reason}", "{fix}")
    NOT_A_RANGE = (
        "is not start:end:count",
        "write e.g. 0.1:0.9:5, or 1:1000:4:log; text goes in quotes within quotes",
    )
    RANGE_COUNT = (
        "has no count from 2 to {most:,} after its ends",
        "write e.g. 0.1:0.9:5, or 1:1000:4:log; text goes in quotes within quotes",
    )
    DISTRIBUTION_WRONG = ("{fault}", "write e.g. {example}")

    AXIS_WITHOUT_VALUES = (
        "has no =",
        (
            "write KEY=VALUES, in quotes if it has spaces, e.g. "
            "objects.ball.mass=100,200"
        ),
    )
    AXIS_IS_TEXT = ("is plain text", "a distribution begins with ~: {key}=~{values}")
    NOT_A_FOLDER_OF_CLIPS = (
        "is not a folder",
        "name folders that were rendered or exported into",
    )
    FOLDERS_SHARE_CLIPS = ("and {other} have the same clips", "name only one of them")
    NOT_RENDERED_INTO = ("is not a folder", "name folders that were rendered into")
    NO_CLIP_IN_FOLDER = (
        "has no clip",
        "name a folder that physgen rendered into, e.g. out",
    )
    MANIFEST_DAMAGED = (
        "is damaged: it is not a manifest that can be read",
        "render the scene again",
    )
    WORKER_LACKS_FOLDER = (
        "does not exist on a worker, {node}",
        "run this from a folder that workers share, or add --ship URL",
    )
    WORKER_VERSION = (
        "has {version}, but this machine has {here}: its results would differ",
        "install the same on both",
    )
    WORKER_WITHOUT_PHYSGEN = (
        "has no physgen, or another one ({error})",
        "install the same on both",
    )
    NO_SCHEDULER_ANSWERS = (
        "is not a scheduler that answers within {timeout:g} s ({reason})",
        (
            "check that it runs and that this machine reaches it; `dask scheduler` "
            "starts one"
        ),
    )
    NOT_A_SCHEDULER_FILE = (
        "is not a scheduler file",
        "start it: dask scheduler --scheduler-file FILE.json",
    )
    NO_SCHEDULER_IN_FILE = (
        "has no scheduler",
        "name the file that `dask scheduler --scheduler-file FILE.json` writes",
    )
    NOT_A_SPLIT = (
        "is not a split with its share of the photos",
        "write e.g. train=0.8,validation=0.1,test=0.1",
    )
    SPLITS_NOT_ONE = ("adds up to {total:.6g}", "make the shares add up to 1")
    NO_MANIFEST = ("has no manifest that can be read", "render it again")
    SAMPLE_MANIFEST_DAMAGED = ("has a damaged manifest", "render it again")
    NO_VIDEO_IN_CLIP = ("has no {file}", "render it with --export")
    FILE_OF_CLIP_MISSING = ("is missing", "render the clip again")
    SAMPLE_FAILED = ("failed: {error}", "run the command again")
    NO_USABLE_CLIP = (
        "has no clip that can be used",
        "name folders that physgen rendered or exported into",
    )
    SAMPLES_CALLED_ALIKE = (
        "is called {name}, as another clip is",
        "give one of their folders another name",
    )
    OUTPUT_AMONG_INPUTS = (
        "{place} {root}, which is read",
        "name a folder beside it with -o",
    )
    OUTPUT_NOT_EMPTY = ("is not empty", "choose another folder with -o, or remove it")
    OUTPUT_NOT_REPLACEABLE = ("cannot be replaced", "name a new folder in it with -o")
    WEBDATASET_MISSING = ("needs webdataset, which is not installed", "{install}")
    NOT_A_STORE = (
        "is not a store ({reason})",
        "write e.g. s3://BUCKET/NAME, and install the package for it",
    )
    STORE_UNWRITABLE = (
        "cannot be written ({reason})",
        "name a store in which you may write",
    )
    OUTSIDE_WORKING_FOLDER = (
        "is outside the working folder",
        "with --ship, run the command in a folder that has the scenes and results",
    )
    NO_CLIP_IN_STORE = (
        "has no clip in {url}",
        "name a folder below {url} that has clips",
    )
    VALUES_NOT_YAML = (
        "is not YAML with commas between the values",
        (
            "close brackets and quotes, and put text with such a character in "
            "quotes within quotes"
        ),
    )
    VALUES_WITH_COMMENT = (
        "has # after a space, which begins a comment",
        "put text with # in quotes within quotes",
    )
    VALUES_MIXED = (
        "mixes values and a distribution",
        "write the distribution alone, or ~choice(...)",
    )
    VALUES_MISSING = (
        "has no values",
        "write some, with commas between them; null removes a key",
    )
    TWICE_IN_LIST = ("has {value} twice", "keep one")
    RANGE_WITHOUT_LENGTH = (
        "ends where it begins",
        "write {value} alone, or another end",
    )
    RANGE_WITHOUT_LOGARITHM = (
        "has no logarithm: an end is 0, or 0 is between the ends",
        "take both above 0, or both below",
    )
    UNKNOWN_DISTRIBUTION = ("is not a known distribution", "{fix}")
    SOURCE_MOVED = (
        "does not exist",
        "the clip or the scene was moved; name it with --scene FILE",
    )
    # Measures and labels
    LIBRARY_MISSING = ("needs {library}, which is not installed", "{install}")
    UNKNOWN_FORMAT = ("is not a format", "{fix}")
    TOO_MANY_FOR_FORMAT = (
        "are more than {format} can number: {most}",
        "choose coco, which has no limit, or leave objects out",
    )
    FORMAT_WITHOUT_PHOTO = (
        "is made from the maps of a photo, but the scene has no photo",
        "leave {format} out",
    )
    FORMAT_WITHOUT_MAP = (
        "is made from {map}.png, which does not exist",
        "make it: physgen perceive --refresh {scene}{option} -o NEW.yaml",
    )
    SIDE_TOO_LONG = (
        "is over the {most} px per side of this format",
        "render with --format png",
    )
    ENCODING_REFUSED = ("could not be encoded ({reason})", "render with --format png")
    # Perception, clips and reports
    WEIGHTS_NOT_A_FILE = (
        "does not exist: the weights of {model}",
        "write {form}, or OWNER/NAME of the hub",
    )
    WEIGHTS_OFFLINE = (
        "has the weights of {model}, and is not on this machine; the hub cannot be asked",
        "{fix}",
    )
    WEIGHTS_ABSENT = (
        "has the weights of {model}, and is not on this machine ({cause})",
        "{fix}",
    )
    WEIGHTS_TOO_LARGE = (
        "does not fit into the memory: {cause}",
        'choose a smaller model, or write dtype = "bfloat16" or device = "cpu" in '
        "physgen.toml",
    )
    WEIGHTS_BROKEN = ("does not load as {model} ({cause})", "{fix}")
    SERVER_FAILED = (
        "{failure}",
        "check {url} (mostly with /v1), {model} (one that takes pictures), {key} and "
        "[vlm] timeout",
    )
    NOT_IN_MASK = ("has no pixel in mask.png", "remove it, or paint its mask")
    UNKNOWN_SIM_KEY = ("is not a key of sim.yaml", "{fix}")
    NOT_A_LABEL_MAP = (
        "is not a label map: it has {count}",
        "give each object one id or colour, without soft borders, saved as PNG",
    )
    MASKS_OF_SPECKS = (
        "shows no object of {least} px or more",
        "mark them with --masks FILE, --box x,y,w,h or --point x,y",
    )
    MASKS_EMPTY = (
        "shows no object",
        "mark them with --masks FILE, --box x,y,w,h or --point x,y",
    )
    PROMPT_IN_SHARES = ("is less than a pixel", "{fix}")
    BOX_NEGATIVE = ("has a negative side", "{fix}")
    BOX_TOO_SMALL = ("is under {least:.3g} px wide or high", "{fix}")
    PROMPT_OFF_PHOTO = ("is outside the {width:g} x {height:g} photo", "{fix}")
    BOX_BEYOND_PHOTO = (
        "reaches {excess:g} px beyond the {width:g} x {height:g} photo",
        "{fix}",
    )
    PROMPT_REPEATED = ("shows the same object as another box or point", "leave one out")
    POINT_SHOWS_NOTHING = (
        "shows no object with a border around it",
        "draw a box around it: --box x,y,w,h",
    )
    NOT_A_DIRECTION = ("is not a direction", "{fix}")
    IMPACTS_INEXACT = (
        "needed more work than a run may do: later ones are less exact",
        "bring their masses closer",
    )
    STEPS_INEXACT = (
        "needed more work than a run may do: later steps are less exact",
        "look for a corner that reaches far out, or slow it down",
    )
    CLIP_REPLACED = (
        "the earlier clip of {scene} is replaced",
        "rename a scene, or choose another folder with -o, to have both",
    )
    FILES_REPLACED = (
        "{files} of an earlier run is removed",
        "name all formats at once, or choose another folder with -o, to have both",
    )
    KICK_WITHOUT_OBJECTS = (
        "hits no object: the scene has none",
        "add one: physgen perceive PHOTO --box X,Y,W,H or --point X,Y, or an entry of "
        "objects",
    )
    NOTHING_MOVES = ("nothing moves in this clip", "{fix}")
    HARDLY_MOVES = (
        "the push moves nothing by 5 % of the picture",
        "push faster, or push another object: --push NAME=DIRECTION",
    )
    NOTHING_TO_MOVE = ("nothing moves in this clip: the scene has no objects", "{fix}")

    NO_DEPTH_FOR_BOUNDARY = (
        "gives no depth for boundary=depth-normals",
        "add --backend depth=marigold",
    )
    DEPTH_NOT_FINITE = ("gives no finite depth", 'write dtype = "float32"')
    MAP_FILE_MISSING = ("names no file", "write {role}=file:PATH")
    MAP_FILE_LOST = ("does not exist", "name a file, .npy or a picture")
    MAP_FILE_UNREADABLE = ("is not a {kind}", "save {content} {form}")
    NOT_A_MAP = ("is not a map of {content}", "save {shape} finite numbers")
    PROPORTIONS_DIFFER = (
        "has other proportions than the photo's {width} x {height} px",
        "save it in the photo's size",
    )
    FILL_WITHHELD = (
        "is withheld by the safety checker of the weights",
        "choose another seed or prompt, or inpaint=fill",
    )
    COLOURS_NOT_FINITE = ("paints no finite colours", 'write dtype = "float32"')
    LAMA_NOT_A_FILE = (
        "is not a file",
        "write inpaint=lama:PATH, the path of big-lama.pt",
    )
    LAMA_UNREADABLE = ("{reason}", "write inpaint=lama:PATH, the path of big-lama.pt")
    WRONG_PIPELINE = ("is a {name}: not for {role}", "{fix}")
    PREDICTION_NOT_FINITE = (
        "leaves no finite {role} on {device}",
        'write dtype = "float32"',
    )
    NO_ALBEDO = (
        "gives {outputs}, no albedo",
        "choose prs-eth/marigold-iid-lighting-v1-1",
    )
    TOO_MANY_WEIGHTS = (
        "names {count} weights for {name}",
        "write at most {most}, with a comma between",
    )
    NOT_A_DEVICE = ("is not a device", "choose auto or {best}")
    DEVICE_MISSING = ("is missing: torch {version} finds none", "choose auto or {best}")
    NO_SERVER = (
        "has no server or no model to ask",
        (
            "set {url} and {model} (its key in {key}), or write url and model below"
            " [vlm] in physgen.toml"
        ),
    )
    SERVER_NOT_ADDRESS = (
        "has a {url} that is not an address",
        "write e.g. http://localhost:8000/v1",
    )
    LABEL_WITHOUT_NAME = ("is not NAME=TEXT", "{fix}")
    LABEL_OF_NO_OBJECT = ("matches no object", "{fix}")
    UNKNOWN_LABEL = (
        "is not in the material table, as an object or a material",
        "{fix}",
    )
    IMPORT_NOT_FOLDER = ("is not a folder", "name one with {needed}")
    IMPORT_FILE_MISSING = ("no such file", "the folder needs {needed}")
    IMPORT_SIZE = ("differs from original.png's {size}", "make them one size")
    ARRAY_UNREADABLE = (
        "is not an array that can be read ({reason})",
        "save it with numpy.save",
    )
    ARRAY_WRONG = ("is not an array of {wanted} numbers", "save it at the photo's size")
    ARRAY_NOT_FINITE = ("is among its numbers", "replace these numbers")
    NOT_IN_OBJ_INFO = ("is not in obj_info", "obj_info has {names}")
    SIM_VALUE_MISSING = ("is missing", "write {wanted}")
    SIM_VALUE_WRONG = ("has the wrong form", "write {wanted}")
    NAMES_FOLLOW_LABELS = (
        "in the scene, since names follow labels",
        "use the new names; physgen rename gives others",
    )
    PHOTO_TOO_SMALL = (
        "is too small to find objects in",
        "use a photo of at least {least} px a side",
    )
    REMAINS_BEHIND = (
        "may be a part of it that stays behind when it moves",
        "add it with --box around the whole object, or in physgen edit by the brush",
    )
    BOX_EMPTY = (
        "shows no object",
        "draw it closer around an object, or give the object's mask: --masks FILE",
    )
    BOX_OFF_PHOTO = (
        "is outside the {width} x {height} photo",
        "write x,y,width,height in px",
    )
    BOX_TOO_LITTLE = (
        "has under 4 px of the {width} x {height} photo",
        "write x,y,width,height in px",
    )
    POINT_OFF_PHOTO = ("is outside the {width} x {height} photo", "write x,y in px")
    FILES_WOULD_BE_LOST = (
        "has {files} of an earlier run, which would be removed",
        "name all formats at once, or choose another folder with -o",
    )
    ENERGY_ERROR = ("has an error of {error} of the energy that flows", "{fix}")
    ALL_LEFT = (
        "all that moves has left the picture by {time:.2g} s of {duration:g} s",
        (
            "write boundaries that stop it, a lower velocity, or a shorter "
            "world.duration"
        ),
    )
    RATE_REDUCED = (
        "is more than a {format} file can play: it gets {fastest:g}",
        "write {fastest:g} or less, or choose mp4, to have all frames",
    )
    NOTHING_UNCERTAIN = (
        (
            "nothing in the scene is uncertain, so every draw would be the same and"
            " none is made"
        ),
        (
            "write the source and confidence of a number, as perceive does: from: "
            '{{mass: "by eye 0.6"}}'
        ),
    )
    CLIP_KEPT = ("{content}", "correct that, then run the same command again")
    NAME_NOT_PRINTABLE = (
        "has characters in its name that cannot be shown",
        "rename the file: its name becomes that of a folder",
    )
    PUSH_MOVES_NOTHING = ("moves nothing now", "{fix}")
    OBJECTS_GIVEN_TWICE = (
        "has the objects in more than one way",
        "choose --masks, or --box and --point",
    )
    PROFILE_UNUSABLE = ("cannot be used", "save it as sRGB if its colours look wrong")
    PHOTO_MADE_SMALLER = ("was made {size}", "--side {width} keeps its size")
    MASKS_SIZE = (
        "differs from the {width} x {height} px of {image}",
        "draw the masks on this photo, in its size",
    )
    FIND_HAS_NO_EFFECT = (
        "has no effect: no backend here finds named objects",
        "choose e.g. --backend segment=grounding-dino+sam",
    )
    CATEGORIES_HAVE_NO_EFFECT = (
        "has no effect: segment={name} needs no categories",
        "choose e.g. --backend segment=grounding-dino+sam, or leave it out",
    )
    VALUE_OF_OTHER_PHOTO = (
        "is of the photo with other proportions, and is left out",
        "set it again for the new photo",
    )
    NO_OBJECT_FOUND_AGAIN = (
        "none of the objects is found in the photo of other proportions",
        "restore the photo, or perceive it anew with --masks, --box or --point",
    )
    OBJECT_NOT_FOUND_AGAIN = (
        "is not found by this name in the photo of other proportions",
        "compare it with the objects that were found, or point at it",
    )
    REFRESH_WITHOUT_PHOTO = ("has no photo", "name a scene with image:")
    POINTED_PART_LOST = (
        "is part of an object that was pointed at, and is removed",
        "leave the box or point out to keep it",
    )
    DIRECTION_FIRST = (
        "has the direction before the object",
        "write --push {name}={direction}",
    )
    NO_DIRECTION = ("has no direction", "write --push {name}=right")
    PUSH_WITHOUT_SIGN = ("has no =", "write --push {name}={rest}")
    CANNOT_FALL = (
        "cannot fall: the photo is seen from above",
        "write --push {name}=right",
    )
    PUSHED_NAME_UNKNOWN = ("is not an object", "{fix}")
    STORY_WITHOUT_VERB = (
        "has no verb that is known",
        "say what happens with one of {verbs}",
    )
    STORY_WITHOUT_OBJECT = ("names no object of the scene", "name one of {names}")
    STORY_WITH_OTHERS = ("cannot be combined with {flag}", "remove one of them")
    STORY_NOUN_UNKNOWN = ("is not in the scene", "name one of {names}")
    TRACKS_NOT_TEXT = ("is not text", "save it as CSV in UTF-8")
    TRACKS_COLUMN_MISSING = ("is not a column", "write the columns {columns}")
    TRACKS_UNKNOWN_OBJECT = ("is not an object of the scene", "{fix}")
    TRACKS_NOT_NUMBER = ("is not a number", "write {unit}")
    TRACKS_LATE = (
        "is not within the {longest:g} s that a fit simulates",
        "write times in seconds, not frames or milliseconds",
    )
    TRACKS_TWICE = (
        "is twice at {time:g} s",
        "write one line for each time and object",
    )
    TRACKS_FEW = ("are too few for a fit", "give {least} times or more")
    FIT_UNKNOWN_KIND = ("cannot be fitted", "{fix}")
    FIT_NOTHING_FREE = ("cannot be told by this scene and clip", "{fix}")
    FIT_KIND_ABSENT = (
        "cannot be told by this scene and clip, and is ignored",
        "leave it out",
    )
    FIT_NOT_SCENE_NAME = (
        "is not a name for the fitted scene",
        "end it in .yaml, e.g. {example}",
    )
    FIT_OUTPUT_BLOCKED = (
        "is a file where a folder is needed",
        "write another name",
    )
    FIT_OUTPUT_APART = (
        "leaves the files of the scene ({files}) outside its folder",
        "write it beside the scene, e.g. {example}, or allow files outside its folder",
    )
    FIT_SLOW_TRACKS = ("has no effect on tracks, which have times", "leave it out")
    FIT_FRAMES_LEFT = (
        "at the end are left out: {most} are followed",
        "give a shorter clip",
    )
    FIT_NEEDS_FILM = ("needs a clip or a table of tracks", "name one of them")
    FIT_FILE_MISSING = ("does not exist", "write the path of an existing file")
    FIT_NEEDS_SCIPY = ("needs scipy", "{install}")
    FIT_CLIP_SIZE = (
        "is not the photo's size, {width} x {height} px",
        "scale the clip to that size, or perceive its first frame",
    )
    FIT_CLIP_WITHOUT_RATE = (
        "has no frame rate",
        "save it as MP4, GIF or WebP, or give its tracks",
    )
    FIT_POOR = (
        "remain between film and simulation, more than the tracks' noise",
        "do not trust the intervals; try the seed {seed}, fewer free values, or a shorter clip",
    )
    FIT_LOST = (
        "is lost after {time} s: its picture no longer explains the film",
        "check the masks of the scene, or give tracks",
    )
    STORY_ANSWERS_UNUSABLE = (
        "was answered by the server without any edit that can be used",
        "pushes are tried instead; another model may do better",
    )
    STORY_SERVER_FAILED = ("; pushes are tried instead", "{fix}")
    STORY_SERVER_FAILED_LATER = ("; the nearest of its proposals is kept", "{fix}")
    STORY_WITHOUT_ACTOR = (
        "moves nothing: what moves must be an object",
        "name an object that is not fixed before the verb",
    )
    NOT_A_SPEED = ("is not a speed", "write e.g. @2 m/s or @300 px/s")
    NOT_TWO_LENGTHS = ("is not two lengths", "write e.g. 120,80 or 6 cm,4 cm")
    KICK_MISSES = (
        "hits no object",
        "name a point of an object; the nearest: {point} of {name}",
    )
    EXTENDED_SCENE_CHANGED = (
        "extends another scene, and the photo or assets of that scene have changed",
        "perceive that scene again",
    )
    OBJECT_LOST = (
        "is not found again in the photo",
        "write prompt: {{box: [x, y, width, height]}} there, or remove the object",
    )
    NOT_A_CLIP_FOLDER = (
        "is not a folder",
        "name folders that physgen rendered into, e.g. out",
    )
    FOLDER_OF_OTHERS = (
        "exists already and was not made by physgen",
        "choose another folder with -o",
    )
    FILES_OF_OTHERS = (
        "would be replaced, but has {files}, which physgen did not make",
        "move these files, or choose another folder with -o",
    )
    FOLDER_FOR_PAGE = ("is a folder", "name a file, e.g. -o out/index.html")
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
        return _fields(self._expected + self._fix)

    def refusal(self, **values: object) -> RefusedError:
        """Return the refusal of a value whose place its caller knows."""
        expected = self._expected.format(**values)
        return RefusedError(expected, self._fix.format(**values), self.code)

    def problem(
        self,
        place: Place,
        path: str | KeyPath = "",
        value_text: str = "",
        /,
        **values: object,
    ) -> Problem:
        """Return the problem of a value at its place."""
        where = path if isinstance(path, str) else dotted(path)
        return self.refusal(**values).problem(place, where, value_text)

    def warning(
        self,
        place: Place,
        path: str | KeyPath = "",
        value_text: str = "",
        /,
        **values: object,
    ) -> Problem:
        """Return the warning about a value at its place."""
        problem = self.problem(place, path, value_text, **values)
        return replace(problem, severity=Severity.WARNING)

    def error(self, file: str, value_text: str = "", /, **values: object) -> InputError:
        """Return the error of one problem with a whole file or a flag."""
        return InputError([self.problem(Place(file), "", value_text, **values)])

    def error_at(
        self,
        place: Place,
        path: str | KeyPath = "",
        value_text: str = "",
        /,
        **values: object,
    ) -> InputError:
        """Return the error of one problem with a value at its place."""
        return InputError([self.problem(place, path, value_text, **values)])

    def impossible(self, **values: object) -> EditError:
        """Return the error of an edit that this scene does not allow."""
        refusal = self.refusal(**values)
        return EditError(
            EditRefusal.IMPOSSIBLE, refusal.expected, refusal.fix, code=refusal.code
        )
