"""Direct light from a panorama, against what can be worked out by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pbrnet.model.data.direct_light import (
    direct_shading,
    lamps_in_view,
    mean_bounces,
    panorama_radiance,
    pixel_rays,
    reflected_light,
)
from pbrnet.model.data.display import DEFAULT_WHITE
from pbrnet.model.data.encoding import (
    DIRECT_RANGE,
    encode,
    shading_exposure,
    solid_angles,
    targets,
    to_image,
)
from pbrnet.model.data.reader import Dataset, Example, mirrored
from pbrnet.pipeline.panorama_lights import panorama_directions, sources
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap
from pbrnet.scenes.arrays import FloatingArray
from pbrnet.scenes.color import luminance
from tests.fixtures.model import box_dataset, made_example

SIZE = (60, 80)  # rows, columns


def wall(distance: float = 2.0, panorama: int = 256) -> Example:
    """A grey wall square to the optical axis, `distance` metres ahead, and no light."""
    rows, columns = SIZE
    nothing = np.zeros((rows, columns, 3), np.float32)
    dark = np.zeros((panorama // 2, panorama), np.float32)
    return made_example(
        depth=np.full(SIZE, distance, np.float32),
        normal=np.broadcast_to(np.float32([0, 0, -1]), nothing.shape),
        reflectance=nothing + 0.5,
        valid=np.ones(SIZE, bool),
        intensity=dark,
        distance=dark,
        intrinsics=np.array([[64.0, 0, columns / 2], [0, 64.0, rows / 2], [0, 0, 1]]),
        shading=nothing,
        color=nothing,
    )


def with_lamp(view: Example, place: tuple[float, float, float], power: float) -> Example:
    """One panorama pixel that shines: a lamp of the radiant intensity `power` at `place`."""
    height, width = view["intensity"].shape
    metres = float(np.linalg.norm(place))
    toward = np.array(place) / metres
    row, column = np.unravel_index(
        (panorama_directions(view["intensity"]) @ toward).argmax(), (height, width)
    )
    intensity, distance = view["intensity"].copy(), view["distance"].copy()
    intensity[row, column] = power / (solid_angles(view["intensity"])[row, 0] * metres**2)
    distance[row, column] = metres
    return view.having(intensity=intensity, distance=distance)


@pytest.mark.parametrize("place", [(0.5, -1.0, -1.5), (0, 0, -3), (2, 1, -0.2), (0.3, 0.2, 1.0)])
def test_a_lamp_lights_a_wall_by_cosine_and_square_of_distance(
    place: tuple[float, float, float],
) -> None:
    view = with_lamp(wall(), place, power=3.0)
    lit = direct_shading(view, albedo=0.5)[..., 1]
    # where the panorama's pixel has the lamp: its centre is half a pixel off at most
    lamp = sources(panorama_radiance(view), view["distance"])[0][0].astype(float)
    assert np.linalg.norm(lamp - place) < np.linalg.norm(place) * np.pi / 128
    point = pixel_rays(view).astype(float) * 2.0
    away = lamp - point
    metres = np.linalg.norm(away, axis=-1)
    expected = 0.5 / np.pi * 3.0 * np.maximum(-away[..., 2] / metres, 0) / metres**2
    seen = np.zeros(SIZE, bool)
    if place[2] > 0:  # the lamp itself is in the picture: a few pixels show it
        seen = lit > 2 * expected.max()
        assert 0 < seen.sum() < 20
    assert lit[~seen] == pytest.approx(expected[~seen], rel=1e-4)


def test_a_lamp_behind_the_wall_leaves_it_dark() -> None:
    view = with_lamp(wall(2.0), (0, 0, 4.0), power=3.0)
    lit = direct_shading(view, 0.5)[..., 1]
    assert (lit > 0).sum() < 20  # but for the pixels that would show the lamp


def test_lamps_add_up_and_two_in_one_cell_keep_their_power() -> None:
    first, second = ((0.5, -1.0, -1.5), 2.0), ((-1.0, -1.2, 0.1), 1.0)
    one, other = (direct_shading(with_lamp(wall(), *lamp), 0.5) for lamp in (first, second))
    both = direct_shading(with_lamp(with_lamp(wall(), *first), *second), 0.5)
    assert both == pytest.approx(one + other, rel=1e-4)
    near = with_lamp(with_lamp(wall(), (0, 0, -3), 2.0), (0.08, 0, -3), 1.0)
    power = sources(panorama_radiance(near), near["distance"])[1]
    assert power.sum(axis=0) == pytest.approx([3.0] * 3, rel=1e-5)


def test_lamps_light_in_their_own_colours() -> None:
    """A red lamp and a green one: each wall's light is the sum of both, band by band."""
    lamps = [((1.0, -1.0, -1.5), 2.0), ((-1.0, 1.2, -1.1), 1.0)]
    views = [with_lamp(wall(), *lamp) for lamp in lamps]
    colours = np.float32([[3.0, 0.5, 0.1], [0.2, 1.3, 0.4]])
    colours /= luminance(colours)[:, None]
    tint = sum((v["intensity"] > 0)[..., None] * c for v, c in zip(views, colours, strict=True))
    both = with_lamp(views[0], *lamps[1])
    lit = direct_shading(both.having(tint=tint), 0.5)
    plain = [direct_shading(view, 0.5)[..., :1] for view in views]
    assert lit == pytest.approx(plain[0] * colours[0] + plain[1] * colours[1], rel=1e-4)
    assert luminance(lit) == pytest.approx(direct_shading(both, 0.5)[..., 0], rel=1e-4)


def test_where_no_surface_is_the_source_behind_it_is_seen() -> None:
    view = wall()
    sky = np.full_like(view["intensity"], 7.0)
    window = view.having(
        valid=np.zeros(SIZE, bool), depth=0 * view["depth"], intensity=sky, distance=sky
    )
    assert (direct_shading(window, 0.5) == 7.0).all()


def test_no_light_is_black_and_finite() -> None:
    assert not direct_shading(wall(), 0.5).any()


def test_direct_light_mirrors_with_its_view_and_follows_brightness(tmp_path: Path) -> None:
    example = next(Dataset(box_dataset(tmp_path) / "dataset", "train").ordered())
    colors = np.random.default_rng(0).uniform(0.2, 2, (*example["intensity"].shape, 3))
    example = example.having(tint=colors.astype(np.float32))
    lit = direct_shading(example, 0.5)
    assert direct_shading(mirrored(example), 0.5) == pytest.approx(lit[:, ::-1], rel=1e-3)
    brighter = example.having(intensity=100 * example["intensity"])
    assert direct_shading(brighter, 0.5) == pytest.approx(100 * lit, rel=1e-4)


def test_in_a_box_with_a_bulb_it_is_the_truth(tmp_path: Path) -> None:
    """The test world is lit by one bulb and a little even light: direct light is nearly all."""
    for example in Dataset(box_dataset(tmp_path) / "dataset", "train").ordered():
        lit = direct_shading(example, 0.5)[..., 0]
        truth = example["shading"][..., 0] - 0.5 * 0.5 / np.pi
        outside = lit < 50  # not the bulb itself, which the truth does not show
        kept = outside & (truth > 0.02)
        ratio = lit[kept] / truth[kept]
        assert np.percentile(ratio, 90) / np.percentile(ratio, 10) < 1.15


def lit_wall() -> Example:
    view = with_lamp(with_lamp(wall(), (0.5, -1.0, -1.5), 2.0), (-1.0, -1.2, 0.1), 1.0)
    valid = view["valid"].copy()
    valid[:5, :9] = False
    return view.having(valid=valid)


def input_light(view: Example, share: np.ndarray | float = 1.0) -> np.ndarray:
    """Direct light of which `share` arrives, half of it reflected on, and the sources in view."""
    light = reflected_light(view.without("visibility"), 0.5) * share
    light[view["valid"]] += light[view["valid"]].mean(0)
    return light + lamps_in_view(view)[0].permute(1, 2, 0).numpy()


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.9])
def test_bounces_are_those_of_an_integrating_sphere(albedo: float) -> None:
    """Of the flux F onto its wall A, a sphere has the radiance F albedo / (pi A (1 - albedo))."""
    generator = np.random.default_rng(3)
    onto = generator.exponential(size=(1, 3, 12, 16)).astype(np.float32)  # irradiance
    valid = generator.random((1, 1, 12, 16)) < 0.7
    mean = (onto * valid).sum((2, 3)) / valid.sum()
    reflected, seen = torch.from_numpy(onto * albedo / np.pi), torch.from_numpy(valid).float()
    found = mean_bounces(reflected, seen, albedo)[..., 0, 0].numpy() + mean * albedo / np.pi
    assert found == pytest.approx(mean * albedo / (np.pi * (1 - albedo)), rel=1e-5)


def test_without_surfaces_nothing_bounces() -> None:
    nothing = torch.zeros(1, 1, 4, 4)
    assert mean_bounces(torch.ones(1, 3, 4, 4), nothing, 0.5).eq(0).all()


def displayed(light: FloatingArray) -> FloatingArray:
    """Display values of light whose log average is exposed, with the fixed white point."""
    return tonemap(light, Exposure(exposure_of(light, ToneParams()).scale, DEFAULT_WHITE))


def test_the_input_is_light_of_a_grey_room_in_its_own_exposure() -> None:
    view = lit_wall()
    light = input_light(view)
    exposure = exposure_of(light, ToneParams())
    display, logarithm = encode([view], ("direct",))["direct"][0].numpy()
    assert (display + 1) / 2 == pytest.approx(displayed(light)[..., 0], abs=1e-5)
    exposed = np.clip(exposure.scale * light[..., 0], *DIRECT_RANGE)
    assert logarithm == pytest.approx(np.log(exposed) / 4, abs=1e-5)


def test_the_input_knows_neither_the_unit_nor_shadows_nor_colours() -> None:
    view = lit_wall()
    plain = encode([view], ("direct",))["direct"]
    told = view.having(
        intensity=view["intensity"] * 8,
        visibility=np.zeros(SIZE, np.float32),
        tint=np.broadcast_to(np.float32([2, 0.5, 0.1]), (*view["intensity"].shape, 3)),
    )
    assert torch.allclose(encode([told], ("direct",))["direct"], plain, atol=1e-5)


def test_the_input_in_colour_is_direct_light_by_the_tints() -> None:
    view = lit_wall()
    white = np.ones((*view["intensity"].shape, 3), np.float32)
    grey = encode([view], ("direct",))["direct"]
    same = encode([view.having(tint=white)], ("direct_colour",))["direct_colour"]
    assert torch.allclose(same, grey.repeat_interleave(3, dim=1), atol=1e-5)
    lit = view.having(tint=white * np.float32([2, 0.8, 0.1]), visibility=np.zeros(SIZE, np.float32))
    light = input_light(lit)
    display = encode([lit], ("direct_colour",))["direct_colour"][0, :3].permute(1, 2, 0).numpy()
    expected = displayed(light)
    assert (display + 1) / 2 == pytest.approx(expected, abs=1e-5)


def test_the_input_with_shadows_is_direct_light_by_the_visibility() -> None:
    view = lit_wall()
    share = np.ones(SIZE, np.float32)
    plain = encode([view], ("direct",))["direct"]
    same = encode([view.having(visibility=share)], ("direct_shadows",))["direct_shadows"]
    assert torch.equal(same, plain)
    share[:, ::2] = 0.25
    light = input_light(view, share[..., None])
    shaded = view.having(visibility=share)
    display = encode([shaded], ("direct_shadows",))["direct_shadows"][0, 0].numpy()
    expected = displayed(light)[..., 0]
    assert (display + 1) / 2 == pytest.approx(expected, abs=1e-5)


def test_the_product_of_a_grey_wall_is_its_direct_light() -> None:
    view = lit_wall().having(visibility=np.ones(SIZE, np.float32))
    shadowed = encode([view], ("direct_shadows",))["direct_shadows"]
    both = encode([view], ("direct_product",))["direct_product"]
    assert torch.equal(both[:, :2], shadowed)
    light = input_light(view)
    expected = tonemap(light, exposure_of(light, ToneParams()))
    assert to_image((both[:, 2:] + 1) / 2) == pytest.approx(expected, abs=5e-3)
    half = view["reflectance"].copy()
    half[:, : SIZE[1] // 2, 0] = 0.1  # little red on the left
    tinted = encode([view.having(reflectance=half)], ("direct_product",))["direct_product"]
    left, _ = tinted[0, 2:].split(SIZE[1] // 2, dim=2)
    assert torch.equal(tinted[:, :2], shadowed)
    assert torch.allclose(left[1], left[2], atol=1e-5)
    assert (left[0] <= left[1]).all() and (left[0] < left[1]).float().mean() > 0.5


def test_a_mirrored_view_has_the_mirrored_input() -> None:
    view = lit_wall()
    plain, turned = (encode([one], ("direct",))["direct"] for one in (view, mirrored(view)))
    assert torch.allclose(turned.flip(-1), plain, atol=2e-3)
    assert not torch.allclose(turned, plain, atol=0.1)


def test_without_light_the_input_is_finite() -> None:
    dark = encode([wall()], ("direct",))["direct"]
    assert dark.isfinite().all()
    assert (dark[0, 0] == -1).all()


def test_tensors_give_the_input_of_arrays() -> None:
    """All cells of the panorama are sources for torch's exporter, a row at a time."""
    view = lit_wall()
    names = ("depth", "valid", "normal", "intensity", "distance", "K")
    tensors = {name: torch.from_numpy(np.ascontiguousarray(view[name])) for name in names}
    plain, traced = (encode([each], ("direct",))["direct"] for each in (view, tensors))
    assert torch.allclose(plain, traced, atol=1e-5)


def test_a_lamp_in_view_is_where_its_panorama_has_it() -> None:
    view = with_lamp(wall(), (0.3, 0.2, 1.0), 3.0)
    seen = lamps_in_view(view)[0, 1].numpy()
    row, column = np.unravel_index(seen.argmax(), SIZE)
    assert (column + 0.5, row + 0.5) == pytest.approx((40 + 64 * 0.3, 30 + 64 * 0.2), abs=1.5)
    assert (seen > 0).mean() < 0.01  # three by three pixels of the panorama


def test_shading_has_a_fixed_white_point_unless_colour_shares_its_exposure() -> None:
    light = np.random.default_rng(3).exponential(1.0, (*SIZE, 3)).astype(np.float32)
    own = exposure_of(light, ToneParams())
    view = replace(wall().having(shading=light), exposure_shading=own)
    assert shading_exposure(view, "shared") == own
    assert shading_exposure(view, "own") == Exposure(own.scale, DEFAULT_WHITE)
    assert own.white != pytest.approx(DEFAULT_WHITE, rel=0.2)
    for policy in ("shared", "own"):
        expected = tonemap(light, shading_exposure(view, policy))
        assert to_image(targets([view], policy)["shading"]) == pytest.approx(expected)
