"""A file -> the Scene that it says, with defaults from the schema and the place of everything."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from physgen.problems import InputError
from physgen.scene import scene
from physgen.scene.load import OpenedScene, load

FULL = Path(__file__).parent / "full.yaml"
HEAD = "physgen: 1\nsize: [64, 48]\n"


def write(folder: Path, text: str, name: str = "scene.yaml") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def fails(path: Path, **flags: bool) -> str:
    with pytest.raises(InputError) as caught:
        load(path, **flags)  # type: ignore[arg-type]
    return str(caught.value)


def test_a_star_sets_no_more_than_a_scene_may_hold(tmp_path: Path) -> None:
    objects = "".join(
        f"  o{k}: {{shape: {{circle: {{center: [9, 9], radius: 3}}}}}}\n"
        for k in range(200)
    )
    outline = ", ".join(f"[{k}, {k * k % 97}]" for k in range(400))
    variant = f"variants:\n  a: {{objects.*.shape: {{polygon: [{outline}]}}}}\n"
    path = write(tmp_path, f"{HEAD}objects:\n{objects}{variant}")
    (problem,) = OpenedScene(path).variant_problems
    assert (problem.variant, problem.path) == ("a", "objects.*.shape")
    assert (problem.place.line, problem.place.column) == (205, 7)
    with pytest.raises(InputError):
        load(path, variant="a")


def test_everything_that_is_written() -> None:
    found = load(FULL)
    assert (found.name, found.title) == ("full", "A ball and a crate")
    assert (found.size, found.image, found.assets) == ((512, 384), None, None)
    assert found.world == scene.Settings(
        scene.View.TOP,
        200,
        (1, 2),
        0.2,
        scene.Combine.MULTIPLY,
        1.5,
        False,
        480,
        4,
        None,
        0.25,
    )
    ball, blob, crate, kite, ring = found.objects
    assert ball == scene.Object(
        name="ball",
        label="billiard ball",
        mask=scene.MaskPolygon(((440, 227), (500, 227), (500, 287), (440, 287))),
        shape=scene.Circle((470.5, 257.0), 30.2),
        solid=scene.Solid.SPHERE,
        mass=170,
        density=None,
        friction=0.3,
        elasticity=0.7,
        rolling=0.01,
        velocity=(-100, 0),
        spin=90,
        roll=(1, 2),
        motion=scene.Motion.DYNAMIC,
        path=(),
        layer=3,
        provenance={"mass": "vlm 0.8"},
        prompt=scene.BoxPrompt((438, 225, 64, 64.5)),
    )
    assert crate.shape == scene.Box((120, 200), (24, 120), 15)
    assert (crate.motion, crate.mass, crate.density) == (scene.Motion.STATIC, None, 2.5)
    assert isinstance(ring.shape, scene.Polygon)
    assert [len(piece.holes) for piece in ring.shape.rings] == [1, 0]
    assert ring.path == (
        scene.Waypoint(0, (20, 20), 0),
        scene.Waypoint(1, (30, 20), 45),
    )
    assert (ring.motion, ring.roll) == (scene.Motion.SCRIPTED, "none")
    assert (blob.shape, blob.mask) == (
        scene.Auto(),
        scene.MaskPolygon(((250, 160), (270, 160), (260, 180))),
    )
    assert (blob.prompt, kite.prompt) == (scene.PointPrompt((260, 170)), None)
    assert kite.shape == scene.Polygon(
        (scene.Ring(((200, 200), (230, 200), (215, 240))),)
    )
    floor, frame, hill, mound = found.boundaries
    assert floor == scene.Boundary("floor", ((0, 457), (512, 457)), None, 0.6, 0.3)
    assert len(frame.points) == 3
    assert hill == scene.Boundary(
        "hill", (), scene.MaskPolygon(((300, 383), (400, 300), (500, 383))), 0.7, 0.4
    )
    assert mound == scene.Boundary(
        "mound", (), scene.MaskPolygon(((10, 383), (60, 383), (35, 340))), 0.5, 0.2
    )
    assert found.forces == (
        scene.Force("ball", scene.Load.IMPULSE, (-1e6, 0), 0, None, 0.5, None),
        scene.Force("crate", scene.Load.TORQUE, (0, 0), 2e6, None, 0.1, 0.2),
        scene.Force("kite", scene.Load.FORCE, (0, -4e5), 0, (301, 98), 0, None),
    )
    kind = scene.JointKind
    assert found.joints == (
        scene.Joint(
            "drive",
            kind.MOTOR,
            ("ball", "crate"),
            ((470.5, 257),),
            None,
            0,
            0,
            360,
            2e9,
            False,
        ),
        scene.Joint(
            "glue",
            kind.WELD,
            ("kite", "crate"),
            ((120, 60),),
            None,
            0,
            0,
            0,
            None,
            True,
        ),
        scene.Joint(
            "hinge", kind.PIVOT, ("kite",), ((215, 150),), None, 0, 0, 0, None, False
        ),
        scene.Joint(
            "line",
            kind.SPRING,
            ("ball", "kite"),
            ((470, 257), (215, 240)),
            80,
            4e4,
            200,
            0,
            None,
            False,
        ),
    )
    assert found.fields == (
        scene.Field(
            "breeze", scene.FieldKind.WIND, ("ball", "kite"), (300, -5), 2e-3, 0, 0
        ),
        scene.Field("magnet", scene.FieldKind.ATTRACTOR, (), (400, 200), 0, -4e7, 5),
    )
    assert found.light == scene.Light((0, 0.6, 0.8), 2, 0.1, 4)
    assert found.render == scene.Render(
        24, 16, False, False, 0.5, (scene.Overlay.OUTLINES, scene.Overlay.TRAILS), 1,
        scene.Play.BACKWARD, None, (832, 480),
        (scene.CameraView(0, (250, 180), None, 1.5), scene.CameraView(1, None, "ball", 2)), 3,
        scene.Noise.MATCH, 8, 0.0, 444, True, True, True, True,
        scene.Striker.CUE,
    )  # fmt: skip
    assert found.refine == scene.Refine(
        "animatediff",
        0.3,
        4,
        20,
        7,
        "a red ball, a photograph",
        "cartoon",
        6,
        0.5,
        0.75,
    )
    assert found.maps == {"depth": (1, 9.5), "shading": (0, 2)}
    assert found.variants == ("hard",)


def test_defaults(tmp_path: Path) -> None:
    found = load(
        write(
            tmp_path,
            HEAD + "objects: {a: {shape: {circle: {center: [9, 9], radius: 3}}}}\n",
        )
    )
    (a,) = found.objects
    assert (a.label, a.mask, a.solid, a.mass, a.density) == ("", None, None, None, 1)
    assert (a.friction, a.elasticity, a.rolling, a.velocity, a.spin) == (
        0.5,
        0.4,
        0,
        (0, 0),
        0,
    )
    assert (a.roll, a.motion, a.layer, a.provenance) == (
        "natural",
        scene.Motion.DYNAMIC,
        0,
        {},
    )
    assert found.world == scene.Settings(
        scene.View.SIDE,
        100,
        (0, 980),
        0,
        scene.Combine.GEOMETRIC,
        2,
        False,
        960,
        4,
        None,
    )
    assert found.render == scene.Render(
        30, None, True, True, 0, (), 1, scene.Play.FORWARD, None, None, (), 1
    )
    assert found.refine == scene.Refine("none", 0.5, 5, 50, 0, None, "", None, 0, 1)
    assert (
        found.light,
        found.forces,
        found.boundaries,
        found.maps,
        found.variants,
    ) == (None, (), (), {}, ())
    assert (found.joints, found.fields) == ((), ())


@pytest.mark.parametrize(
    ("world", "gravity"),
    [
        ("{}", (0, 980)),
        ("{pixels_per_meter: 250}", (0, 2450)),
        ("{view: top}", (0, 0)),
        ("{view: top, gravity: [5, 0]}", (5, 0)),
        ("{pixels_per_meter: 1, gravity: [0, 980]}", (0, 980)),
    ],
)
def test_gravity(world: str, gravity: scene.Point, tmp_path: Path) -> None:
    found = load(write(tmp_path, HEAD + f"world: {world}\n"))
    assert found.world.gravity == gravity
    assert found.document["world"]["gravity"] == list(gravity)


def test_whole_numbers_written_as_floats(tmp_path: Path) -> None:
    found = load(
        write(tmp_path, "physgen: 1.0\nsize: [64.0, 48]\nrender: {frames: 16.0}\n")
    )
    assert (found.size, found.render.frames) == ((64, 48), 16)
    assert isinstance(found.size[0], int)


def test_names_of_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert load(write(tmp_path / "pool", HEAD)).name == "pool"
    assert load(write(tmp_path / "pool", HEAD, "break.yaml")).name == "break"
    monkeypatch.chdir(tmp_path / "pool")
    found = load("scene.yaml")
    assert (found.name, found.folder) == ("pool", tmp_path / "pool")


def test_a_misspelt_path_is_corrected(tmp_path: Path) -> None:
    path = write(
        tmp_path, "physgen: 1\nimage: phto.jpg\nassets: photo.asets\nobjects: {}\n"
    )
    with pytest.raises(InputError) as far:
        load(path)
    assert "did you mean" not in str(far.value)
    (tmp_path / "photo.assets").mkdir()
    (tmp_path / "photo.jpg").touch()
    with pytest.raises(InputError) as near:
        load(path)
    assert [problem.fix for problem in near.value.problems] == [
        'did you mean "photo.jpg"?', 'did you mean "photo.assets"?',
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("image: scene.png", None),  # scene.yaml is no photo
        ("image: ./photos/scen.png", "./photos/scene.png"),
        ("size: [9, 9]\nassets: map/", "maps"),
        ("size: [9, 9]\nassets: table", None),  # a file
        ("size: [9, 9]\nextends: ../pool/scenes.yml", "../pool/scene.yaml"),
        ("size: [9, 9]\nextends: scenee.yaml", None),  # the file itself
        (
            "size: [9, 9]\nextends: ../pool/zz-400.yaml",
            "../pool/zz-40.yaml",
        ),  # one of many
    ],
)
def test_what_was_meant_is_of_its_kind_and_in_its_folder(
    line: str, meant: str | None, tmp_path: Path
) -> None:
    for name in (
        "home/photos/scene.png",
        "home/photos/scen.yaml",
        "home/tables",
        "home/maps/x",
        "pool/scene.yaml",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    for k in range(400):
        (tmp_path / f"pool/aa-{k}.yaml").touch()
    (tmp_path / "pool/zz-40.yaml").touch()
    with pytest.raises(InputError) as caught:
        load(write(tmp_path / "home", f"physgen: 1\n{line}\nobjects: {{}}\n"))
    (fix,) = [problem.fix for problem in caught.value.problems]
    assert fix == f'did you mean "{meant}"?' if meant else "did you mean" not in fix


def test_a_photo_and_its_maps(tmp_path: Path) -> None:
    home = tmp_path / "scene"
    path = write(
        home, "physgen: 1\nimage: photo.jpg\nassets: maps\nobjects: {a: {mask: 7}}\n"
    )
    (home / "maps").mkdir()
    Image.new("RGB", (30, 20)).save(home / "photo.jpg")
    Image.new("I;16", (30, 20)).save(home / "maps" / "masks.png")
    found = load(path)
    assert found.size == (30, 20)
    assert (found.image, found.assets) == (
        (home / "photo.jpg").resolve(),
        (home / "maps").resolve(),
    )
    assert found.objects[0].mask == scene.MaskId(7)
    exif = Image.Exif()
    exif[0x112] = (
        6  # turned by a quarter: is the author's canvas 30 x 20 or 20 x 30? we do not guess
    )
    Image.new("RGB", (30, 20)).save(home / "photo.jpg", exif=exif)
    assert '2:8: image: "photo.jpg" is rotated by its EXIF data alone' in fails(path)


def test_links_within_the_folder_are_followed(tmp_path: Path) -> None:
    home = tmp_path / "scene"
    path = write(home, "physgen: 1\nimage: photo.png\n")
    Image.new("RGB", (30, 20)).save(home / "original.png")
    (home / "photo.png").symlink_to("original.png")
    assert load(path).image == (home / "original.png").resolve()
    (tmp_path / "short").symlink_to(home)
    assert load(tmp_path / "short" / "scene.yaml").size == (30, 20)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    assert fails(tmp_path / "none.yaml").endswith(
        "none.yaml: no such file; write the path of a scene file"
    )
    assert fails(tmp_path).endswith(
        ": is a folder; name a scene file in it, e.g. scene.yaml"
    )
    assert "cannot be read" in fails(tmp_path / ("x" * 3000))
    assert "cannot be read: the path is no path" in fails(Path("a\0b"))
    write(tmp_path, HEAD, "file.yaml")
    assert "cannot be read: not a directory" in fails(
        tmp_path / "file.yaml" / "scene.yaml"
    )


def test_the_document_is_resolved() -> None:
    document = load(FULL, ["objects.ball.mass=3"], "hard").document
    assert document["objects"]["ball"]["mass"] == 3
    assert document["objects"]["ball"]["velocity"] == [-900, 0]
    assert document["objects"]["kite"]["density"] == 1
    assert document["objects"]["kite"]["friction"] == 0.5
    assert document["forces"][0]["start"] == 0.5
    assert document["variants"] == {"hard": {"objects.ball.velocity": [-900, 0]}}
