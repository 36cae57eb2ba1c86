"""Masks that users draw: with opacity, of another size, in several layers, and in formats that change ids."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pillow_heif
import pytest
import yaml
from PIL import Image

from physgen.cli.main import main
from physgen.maps import read_labels, read_object_masks
from physgen.problems import InputError

H, W = 60, 80
U8 = np.ndarray


@pytest.fixture
def ids() -> U8:
    """Two objects: 3 and 7."""
    labels = np.zeros((H, W), np.uint8)
    labels[10:30, 8:30] = 3
    labels[35:55, 45:70] = 7
    return labels


def opacity(ids: U8) -> U8:
    return np.where(ids > 0, 255, 0).astype(np.uint8)


def same_regions(labels: U8, ids: U8) -> bool:
    """Whether two label maps show the same objects under any ids."""
    pairs = np.unique(np.stack([labels.ravel(), ids.ravel()], 1), axis=0)
    return len(pairs) == len(np.unique(ids)) == len(np.unique(labels))


def with_colour(ids: U8, colour: tuple[int, int, int], mode: str) -> Image.Image:
    alpha = Image.fromarray(opacity(ids))
    image = Image.new("RGB", (W, H), colour)
    image.putalpha(alpha)
    return image.convert(mode)


@pytest.mark.parametrize("mode", ["RGBA", "LA", "PA"])
@pytest.mark.parametrize("colour", [(255, 255, 255), (0, 0, 0), (90, 90, 90)])
def test_opaque_regions_of_one_colour_are_objects(
    ids: U8, tmp_path: Path, mode: str, colour: tuple[int, int, int]
) -> None:
    path = tmp_path / "m.png"
    image = with_colour(ids, colour, mode if mode != "PA" else "RGBA")
    if mode == "PA":
        image = Image.fromarray(opacity(ids) // 255).convert("P")
        image.putpalette([*colour, *colour])
        image.save(path, transparency=b"\0\xff")
    else:
        image.save(path)
    assert same_regions(read_object_masks(path), ids)
    assert ((read_labels(path) > 0) == (ids > 0)).all()


def test_opaque_palette_index_zero_is_an_object(ids: U8, tmp_path: Path) -> None:
    image = Image.fromarray((ids == 0).astype(np.uint8)).convert("P")
    image.putpalette([255, 255, 255, 255, 255, 255])
    for name in ("m.png", "m.gif"):
        image.save(tmp_path / name, transparency=1)
        assert same_regions(read_object_masks(tmp_path / name), ids)


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "LA"])
@pytest.mark.parametrize("is_deep", [False, True])
def test_colours_under_opacity_stay_objects(
    ids: U8, tmp_path: Path, mode: str, is_deep: bool
) -> None:
    """Two colours, one of which has two pieces; what is transparent has colours that count for nothing."""
    ids[50:58, 2:20] = 3
    noise = np.random.default_rng(0).integers(0, 256, (H, W, 3))
    grey = mode.startswith("L")
    colours = np.where((ids == 3)[..., None], (40, 90, 200), (250, 20, 60))
    picture = np.where((ids > 0)[..., None], colours, noise)
    if not mode.endswith("A"):
        picture[ids == 0] = 0
    channels = picture[:, :, :1] if grey else picture
    if mode.endswith("A"):
        channels = np.dstack([channels, opacity(ids)])
    if is_deep and not grey:
        order = [2, 1, 0, 3][: channels.shape[2]]
        cv2.imwrite(
            str(tmp_path / "m.png"), (channels[:, :, order] * 257).astype(np.uint16)
        )
    else:
        Image.fromarray(np.squeeze(channels.astype(np.uint8))).save(tmp_path / "m.png")
    for read in (read_labels, read_object_masks):
        assert same_regions(read(tmp_path / "m.png"), ids)


def test_translucent_overlays_and_soft_borders_are_read(
    ids: U8, tmp_path: Path
) -> None:
    soft = cv2.GaussianBlur(opacity(ids), (0, 0), 1.5)
    for share in (1.0, 0.35):
        image = Image.new("RGB", (W, H), "white")
        image.putalpha(Image.fromarray((soft * share).astype(np.uint8)))
        image.save(tmp_path / "m.png")
        found = read_object_masks(tmp_path / "m.png")
        assert found.max() == 2
        assert np.count_nonzero((found > 0) != (ids > 0)) < 40


def test_cut_out_of_photo_is_its_opaque_part(ids: U8, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (H, W, 3), np.uint8)
    Image.fromarray(np.dstack([noise, opacity(ids)])).save(tmp_path / "m.png")
    assert same_regions(read_object_masks(tmp_path / "m.png"), ids)


def test_opaque_pictures_are_read_as_without_opacity(ids: U8, tmp_path: Path) -> None:
    full = np.full((H, W), 255, np.uint8)
    Image.fromarray(np.dstack([ids, ids, ids, full])).save(tmp_path / "m.png")
    for read in (read_labels, read_object_masks):
        assert np.array_equal(read(tmp_path / "m.png"), ids)


def test_ids_with_opacity_keep_their_numbers(ids: U8, tmp_path: Path) -> None:
    Image.fromarray(np.dstack([ids, opacity(ids)])).save(tmp_path / "m.png")
    assert np.array_equal(read_labels(tmp_path / "m.png"), ids)


def test_transparent_picture_is_refused(tmp_path: Path) -> None:
    Image.new("RGBA", (W, H), (255, 255, 255, 0)).save(tmp_path / "m.png")
    with pytest.raises(InputError) as error:
        read_object_masks(tmp_path / "m.png")
    assert error.value.problems[0].place.file == str(tmp_path / "m.png")


@pytest.mark.parametrize("name", ["m.jpg", "m.webp", "m.heic", "m.avif"])
def test_formats_that_change_ids_are_refused(
    ids: U8, tmp_path: Path, name: str
) -> None:
    pillow_heif.register_heif_opener()
    Image.fromarray(ids).convert("RGB").save(tmp_path / name, quality=90)
    with pytest.raises(InputError):
        read_labels(tmp_path / name)
    Image.fromarray(ids).convert("RGB").save(tmp_path / "m.webp", lossless=True)
    assert np.array_equal(read_labels(tmp_path / "m.webp"), ids)


@pytest.mark.parametrize("name", ["m.tif", "m.gif", "m.webp", "m.png"])
def test_several_layers_are_refused(ids: U8, tmp_path: Path, name: str) -> None:
    layers = [Image.fromarray(ids * (ids == k)).convert("L") for k in (3, 7)]
    options = {"lossless": True} if name == "m.webp" else {}
    layers[0].save(tmp_path / name, save_all=True, append_images=layers[1:], **options)
    with pytest.raises(InputError) as error:
        read_labels(tmp_path / name)
    assert "2" in error.value.problems[0].expected


def test_thumbnail_in_tiff_is_no_layer(ids: U8, tmp_path: Path) -> None:
    layers = [Image.fromarray(ids), Image.fromarray(ids[::4, ::4])]
    layers[0].save(tmp_path / "m.tif", save_all=True, append_images=layers[1:])
    assert np.array_equal(read_labels(tmp_path / "m.tif"), ids)


# ---- from the command line ----


@pytest.fixture
def photo(ids: U8, tmp_path: Path) -> Path:
    rgb = np.full((H, W, 3), (150, 158, 165), np.uint8)
    rgb[ids == 3], rgb[ids == 7] = (180, 50, 50), (50, 80, 180)
    Image.fromarray(rgb).save(tmp_path / "photo.png")
    return tmp_path / "photo.png"


@pytest.mark.slow
def test_white_mask_with_alpha_gives_its_objects(
    ids: U8, photo: Path, tmp_path: Path
) -> None:
    with_colour(ids, (255, 255, 255), "RGBA").save(tmp_path / "m.png")
    scene = tmp_path / "s.yaml"
    command = ["perceive", str(photo), "--masks", str(tmp_path / "m.png")]
    assert main([*command, "-o", str(scene)]) == 0
    assert len(yaml.safe_load(scene.read_text())["objects"]) == 2


@pytest.mark.parametrize("size", [(W, H - 1), (H, W), (2 * W, 2 * H), (W // 2, H // 2)])
def test_masks_of_another_size_get_one_message(
    photo: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    size: tuple[int, int],
) -> None:
    masks = tmp_path / "m.png"
    Image.new("L", size, 1).save(masks)
    command = ["perceive", str(photo), "--masks", str(masks)]
    assert main([*command, "-o", str(tmp_path / "s.yaml")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{masks}: {size[0]} x {size[1]} px ")
    assert f"{W} x {H} px" in line
    assert [path.name for path in tmp_path.iterdir() if "s." in path.name] == []


@pytest.mark.slow
def test_message_about_size_names_the_original_photo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not the smaller photo that the scene would get; masks of either size are taken."""
    rgb = np.full((300, 400, 3), 160, np.uint8)
    rgb[100:200, 100:220] = 180, 50, 50
    Image.fromarray(rgb).save(tmp_path / "p.png")
    labels = Image.fromarray((rgb[:, :, 1] == 50).astype(np.uint8))
    command = ["perceive", str(tmp_path / "p.png"), "--side", "200", "-o"]
    for size in ((400, 300), (200, 150), (300, 225)):
        labels.resize(size, Image.Resampling.NEAREST).save(tmp_path / "m.png")
        masks = ["--masks", str(tmp_path / "m.png")]
        code = main([*command, str(tmp_path / f"{size[0]}.yaml"), *masks])
        told = capsys.readouterr().err
        if size[0] == 300:
            assert code == 2
            assert told.count("\n") == 1
            assert "400 x 300 px" in told
        else:
            assert code == 0
