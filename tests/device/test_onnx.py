"""Learned matchers: models built here, some of which really match, so that the answers are right and not just shaped right."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from onnx import TensorProto, helper

from device.shifted_noise import grey, noise
from device.stereo_models import FLOAT, block_matcher, block_matching, constant, port, save, shown
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.match.learned.onnx import OnnxMatcher
from prismstereo_device.match.learned.presets import presets, recognised
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.reasons import Reason
from prismstereo_device.rectify import RectifiedPair
from prismstereo_hw.errors import DataError, UsageError

OPEN = (1, 3, "height", "width")


def matched(
    path: Path, left: np.ndarray, right: np.ndarray, options: str = "scale=none", labels: int = 32, **settings: int
) -> DisparityMap:
    matcher = OnnxMatcher.named(f"onnx:{path},{options}", MatchSettings(**settings))
    return matcher.match(RectifiedPair(left, right, DisparityWindow(labels)))


@pytest.fixture
def pair(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A cloudy pair whose disparity is 12 everywhere."""
    picture = noise(rng, 96, 160)
    return grey(picture), grey(np.roll(picture, -12, axis=1))


@pytest.fixture
def ramp() -> np.ndarray:
    """Grey levels 0 .. 159, each a column."""
    return np.tile(np.arange(160, dtype=np.uint8), (96, 1))


# ---- models that match


@pytest.mark.parametrize("size", [(1, 3, "height", "width"), (1, 1, "height", "width"), (None, 3, 96, 160)])
def test_a_block_matcher_in_a_file_finds_the_shift(
    size: tuple[int | str, ...], pair: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    model = block_matcher(tmp_path / "blocks.onnx", 24, size, ("batch", *size[2:]))
    found = matched(model, *pair)
    np.testing.assert_array_equal(found.disparity_px[:, 20:-20], 12.0)
    columns = np.broadcast_to(np.arange(160), (96, 160))[found.valid]
    assert np.all(found.disparity_px[found.valid] <= columns)  # no partner lies outside of the right picture


def test_a_block_matcher_in_a_file_agrees_with_the_same_sums_in_numpy(rng: np.random.Generator, tmp_path: Path) -> None:
    """Two unlike pictures: every pixel's winner hangs on the least of 16 costs, so a wrong tensor or shift would show."""
    left, right = (grey(noise(rng, 60, 90)) for _ in range(2))
    costs = []
    for d in range(16):
        moved = np.full((60, 90), 1e4)
        moved[:, d:] = right[:, : 90 - d]
        costs.append(cv2.boxFilter(np.abs(left - moved), -1, (9, 9)))
    winners = np.argmin(costs, axis=0)[4:-4, 19:-4]
    found = matched(block_matcher(tmp_path / "blocks.onnx", 16), left, right).disparity_px[4:-4, 19:-4]
    assert np.mean(found == winners) > 0.999  # sums in another order may tip a tie


def test_two_planes_come_back_each_at_its_own_disparity(rng: np.random.Generator, tmp_path: Path) -> None:
    far, near = noise(rng, 96, 160), noise(rng, 96, 160)
    left, right = far.copy(), np.roll(far, -3, axis=1)
    left[24:72, 60:120], right[24:72, 51:111] = near[24:72, 60:120], near[24:72, 60:120]  # in front at 9 px
    truth = np.full((96, 160), 3.0)
    truth[24:72, 60:120] = 9.0
    found = matched(block_matcher(tmp_path / "blocks.onnx", 16), grey(left), grey(right)).disparity_px
    assert (
        np.mean(found[:, 10:-10] == truth[:, 10:-10]) > 0.93
    )  # the rest is 4 px either side of the edge, and occluded


def test_a_picture_that_is_no_multiple_is_padded_and_its_disparity_untouched(
    pair: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    model = block_matcher(tmp_path / "blocks.onnx", 24)
    whole = matched(model, *pair, options="scale=none,multiple=1").disparity_px
    padded = matched(model, *pair, options="scale=none,multiple=64").disparity_px  # 128x192
    assert padded.shape == whole.shape
    np.testing.assert_array_equal(padded[:-4, 20:-20], whole[:-4, 20:-20])


@pytest.mark.parametrize(("height", "width"), [(48, 80), (96, 80), (192, 320)])
def test_a_model_of_another_size_gives_disparity_in_pixels_of_the_picture(
    height: int, width: int, pair: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    model = block_matcher(tmp_path / "blocks.onnx", 30, (1, 3, height, width), (1, height, width))
    found = matched(model, *pair, options="scale=none,fit=resize").disparity_px
    assert found.shape == (96, 160)
    assert np.nanmean(np.abs(found[:, 24:-24] - 12.0) < 0.01) > 0.98


def test_a_larger_model_is_padded_to_and_a_smaller_one_is_not(
    pair: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    large = block_matcher(tmp_path / "large.onnx", 24, (1, 3, 100, 200), (1, 100, 200))
    np.testing.assert_array_equal(matched(large, *pair).disparity_px[:90, 20:-20], 12.0)
    small = block_matcher(tmp_path / "small.onnx", 24, (1, 3, 48, 80), (1, 48, 80))
    with pytest.raises(UsageError, match="pictures of 160x96 are larger than the model's 80x48: padding cannot help"):
        matched(small, *pair, options="scale=none,fit=pad")


def test_edges_stay_edges_when_a_small_map_is_enlarged(tmp_path: Path) -> None:
    """A map of 4 and 20 px, eightfold: no value between them is made up."""
    left = np.full((64, 64), 40, np.uint8)
    left[:, 32:] = 200
    model = shown(
        tmp_path / "levels.onnx", ("left", "right"), (1, 1, 8, 8), (1, 1, 8, 8),
        [helper.make_node("Mul", ["left", "tenth"], ["scaled"]), helper.make_node("Add", ["scaled", "zero"], ["disparity"])],
        [constant("tenth", 0.0125), constant("zero", 0.0)],
    )  # fmt: skip
    found = matched(model, left, left).disparity_px[:, 24:]
    assert set(np.unique(found)) == {4.0, 20.0}


def test_four_inputs_get_the_pair_at_half_size_first(pair: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    """Like CREStereo's: matches the half-size pair, doubles map and disparity, and gives two channels."""
    nodes, constants = block_matching("half_left", "half_right", 12)
    nodes += [
        helper.make_node("Unsqueeze", ["best", "channel_axis"], ["small"]),
        helper.make_node("Resize", ["small", "", "twice"], ["large"], mode="nearest"),
        helper.make_node("Mul", ["large", "two"], ["disparities"]),
        helper.make_node("ReduceMean", ["right"], ["kept"], axes=[1]),
        helper.make_node("Concat", ["disparities", "kept"], ["flow"], axis=1),
    ]
    constants += [constant("twice", [1, 1, 2, 2]), constant("two", 2.0)]
    full, half = (1, 3, 96, 160), (1, 3, 48, 80)
    orders = {
        "crestereo_halves_first": ("half_left", "half_right", "left", "right"),
        "crestereo_halves_last": ("right", "left", "half_right", "half_left"),
    }
    for name, order in orders.items():
        inputs = [port(each, half if "half" in each else full) for each in order]
        model = save(tmp_path / f"{name}.onnx", inputs, [port("flow", (1, 2, 96, 160))], nodes, constants)
        found = matched(model, *pair, options="preset=crestereo")
        np.testing.assert_array_equal(found.disparity_px[:, 24:-24], 12.0)


def test_right_and_left_are_told_by_their_names(pair: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    nodes, constants = block_matching("image_left", "image_right", 24)
    inputs = [port("image_right", OPEN), port("image_left", OPEN)]
    model = save(tmp_path / "blocks.onnx", inputs, [port("best", (1, "height", "width"))], nodes, constants)
    np.testing.assert_array_equal(matched(model, *pair).disparity_px[:, 20:-20], 12.0)


def test_channels_last_in_and_out(pair: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    nodes, constants = block_matching("left_first", "right_first", 24)
    nodes = [
        helper.make_node("Transpose", ["left"], ["left_first"], perm=[0, 3, 1, 2]),
        helper.make_node("Transpose", ["right"], ["right_first"], perm=[0, 3, 1, 2]),
        *nodes,
        helper.make_node("Unsqueeze", ["best", "width_axis"], ["disparity"]),
    ]
    sizes = (1, "height", "width", 3)
    inputs = [port("left", sizes), port("right", sizes)]
    outputs = [port("disparity", (1, "height", "width", 1))]
    model = save(tmp_path / "blocks.onnx", inputs, outputs, nodes, constants)
    np.testing.assert_array_equal(matched(model, *pair).disparity_px[:, 20:-20], 12.0)


@pytest.mark.parametrize("channels", [2, 6])
def test_one_input_takes_both_pictures_stacked(
    channels: int, pair: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    nodes, constants = block_matching("left", "right", 24)
    nodes.insert(0, helper.make_node("Split", ["input"], ["left", "right"], axis=1))
    model = save(
        tmp_path / "hitnet.onnx",
        [port("input", (1, channels, 96, 160))],
        [port("best", (1, 96, 160))],
        nodes,
        constants,
    )
    np.testing.assert_array_equal(matched(model, *pair, options="preset=hitnet").disparity_px[:, 20:-20], 12.0)


def test_a_model_that_counts_to_the_left_is_read_with_its_sign(
    pair: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    nodes, constants = block_matching("left", "right", 24)
    nodes.append(helper.make_node("Neg", ["best"], ["flow"]))
    inputs = [port("left", OPEN), port("right", OPEN)]
    model = save(tmp_path / "blocks.onnx", inputs, [port("flow", (1, "height", "width"))], nodes, constants)
    assert np.isnan(matched(model, *pair).disparity_px[:, 20:-20]).all()
    np.testing.assert_array_equal(matched(model, *pair, options="scale=none,sign=-1").disparity_px[:, 20:-20], 12.0)


def test_the_mirrored_run_drops_what_the_right_view_contradicts(rng: np.random.Generator, tmp_path: Path) -> None:
    far, near = noise(rng, 96, 160), noise(rng, 96, 160)
    left, right = far.copy(), far.copy()
    left[24:72, 60:120], right[24:72, 45:105] = near[24:72, 60:120], near[24:72, 60:120]  # hides 15 columns before it
    model = block_matcher(tmp_path / "blocks.onnx", 24)
    hidden = (slice(30, 66), slice(46, 56))
    sure, all_of_it = (
        matched(model, grey(left), grey(right), f"scale=none,check={answer}") for answer in ("yes", "no")
    )
    assert np.isfinite(all_of_it.disparity_px[hidden]).mean() > 0.9
    assert np.isfinite(sure.disparity_px[hidden]).mean() < 0.1
    assert sure.reasons is not None
    assert np.mean(sure.reasons[hidden] == Reason.OCCLUDED) > 0.8
    np.testing.assert_array_equal(sure.disparity_px[30:66, 68:112], 15.0)
    np.testing.assert_array_equal(sure.disparity_px[4:16, 4:-4], 0.0)


def test_any_number_of_threads_gives_the_same_map(pair: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    model = block_matcher(tmp_path / "blocks.onnx", 24)
    one, two, three = (matched(model, *pair, threads=count).disparity_px for count in (1, 2, 3))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, three)


# ---- what a model is given


@pytest.mark.parametrize(
    ("options", "offset", "span"),
    [
        ("scale=none", (0, 0, 0), (1, 1, 1)),
        ("scale=unit", (0, 0, 0), (255, 255, 255)),
        ("scale=symmetric", (127.5,) * 3, (127.5,) * 3),
        ("scale=imagenet", (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)),
        ("scale=imagenet,order=bgr", (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)),
        ("preset=lightstereo", (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)),
    ],
)
def test_grey_levels_come_on_the_scale_that_was_asked_for(
    options: str, offset: tuple[float, ...], span: tuple[float, ...], ramp: np.ndarray, tmp_path: Path
) -> None:
    """The model turns each channel back into grey levels and gives the largest: any channel on a wrong scale shows."""
    for turn in ("ReduceMax", "ReduceMin"):
        model = shown(
            tmp_path / f"{turn}.onnx", ("left", "right"), OPEN, (1, "height", "width"),
            [
                helper.make_node("Mul", ["left", "span"], ["spread"]),
                helper.make_node("Add", ["spread", "offset"], ["levels"]),
                helper.make_node(turn, ["levels"], ["disparity"], axes=[1], keepdims=0),
            ],
            [constant("span", np.reshape(span, (3, 1, 1))), constant("offset", np.reshape(offset, (3, 1, 1)))],
        )  # fmt: skip
        found = matched(model, ramp, ramp, options, labels=200).disparity_px
        np.testing.assert_allclose(found[:, 1:], ramp[:, 1:], atol=1 / 16)


def test_bytes_and_half_precision_are_made_for_models_that_take_them(ramp: np.ndarray, tmp_path: Path) -> None:
    for kind in (TensorProto.UINT8, TensorProto.FLOAT16, TensorProto.DOUBLE):
        nodes = [
            helper.make_node("Cast", ["left"], ["levels"], to=FLOAT),
            helper.make_node("ReduceMean", ["levels"], ["disparity"], axes=[1], keepdims=0),
        ]
        model = shown(tmp_path / f"{kind}.onnx", ("left", "right"), OPEN, (1, "h", "w"), nodes, kind=kind)
        np.testing.assert_array_equal(matched(model, ramp, ramp, labels=200).disparity_px[:, 1:], ramp[:, 1:])
    with pytest.raises(DataError, match="takes bytes, but scale=unit makes fractions: use scale=none"):
        matched(tmp_path / f"{TensorProto.UINT8}.onnx", ramp, ramp, "scale=unit")


# ---- what is unmatched


def test_what_is_no_number_or_out_of_range_is_unmatched_and_says_why(ramp: np.ndarray, tmp_path: Path) -> None:
    """The model gives sqrt(level - 100) + 2: not a number below level 100."""
    model = shown(
        tmp_path / "root.onnx", ("left", "right"), (1, 1, "h", "w"), (1, 1, "h", "w"),
        [
            helper.make_node("Sub", ["left", "hundred"], ["less"]),
            helper.make_node("Sqrt", ["less"], ["root"]),
            helper.make_node("Add", ["root", "two"], ["disparity"]),
        ],
        [constant("hundred", 100.0), constant("two", 2.0)],
    )  # fmt: skip
    found = matched(model, ramp, ramp, labels=9, first_px=4)  # from level 104 to level 136
    assert found.reasons is not None
    np.testing.assert_array_equal(found.reasons[:, :100], Reason.UNMATCHED)
    np.testing.assert_array_equal(found.reasons[:, 100:104], Reason.TOO_FAR)
    np.testing.assert_array_equal(found.reasons[:, 104:137], Reason.MATCHED)
    np.testing.assert_array_equal(found.reasons[:, 137:], Reason.TOO_NEAR)
    np.testing.assert_array_equal(found.valid, found.reasons == Reason.MATCHED)
    assert found.disparity_px[5, 125] == 7.0


def test_a_search_beyond_what_the_model_finds_is_refused(pair: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    model = block_matcher(tmp_path / "blocks.onnx", 24)
    with pytest.raises(UsageError, match=r"begins at 30 px, but .*blocks.onnx finds at most 24 px: begin below"):
        matched(model, *pair, options="scale=none,max_disparity=24", labels=64, first_px=30)


# ---- which output is the disparity


def _several(path: Path, *outputs: tuple[str, tuple[int | str, ...]]) -> Path:
    """A model that gives the left picture under several names, tenfold less from one to the next."""
    nodes = [helper.make_node("Identity", ["left"], ["level0"])]
    for index, (name, sizes) in enumerate(outputs):
        nodes.append(helper.make_node("Div", [f"level{index}", "ten"], [f"level{index + 1}"]))
        whole = len(sizes) == 4
        nodes.append(
            helper.make_node("Identity", [f"level{index + 1}"], [name]) if whole
            else helper.make_node("ReduceMean", [f"level{index + 1}"], [name], keepdims=0)
        )  # fmt: skip
    ports = [port(name, sizes) for name, sizes in outputs]
    sides = [port(name, (1, 1, "h", "w")) for name in ("left", "right")]
    return save(path, sides, ports, nodes, [constant("ten", 10.0)])


def test_the_disparity_is_found_by_its_shape_then_by_its_name(ramp: np.ndarray, tmp_path: Path) -> None:
    whole = (1, 1, "h", "w")
    by_shape = _several(tmp_path / "shape.onnx", ("confidence", ()), ("result", whole))
    by_name = _several(tmp_path / "name.onnx", ("occlusion", whole), ("output_disp", whole), ("disp_low", whole))
    unclear = _several(tmp_path / "unclear.onnx", ("a", whole), ("b", whole))
    for model, options, divisor in (
        (by_shape, "scale=none", 100.0),
        (by_name, "scale=none", 100.0),
        (by_name, "scale=none,output=occlusion", 10.0),
        (unclear, "scale=none,output=b", 100.0),
    ):
        found = matched(model, ramp, ramp, options).disparity_px
        np.testing.assert_allclose(found[:, 20:], ramp[:, 20:] / divisor, atol=1 / 30)
    with pytest.raises(UsageError, match="several outputs that may be the disparity: add output=NAME, one of a 1x1x"):
        matched(unclear, ramp, ramp)
    with pytest.raises(UsageError, match="has no output 'c': choose one of a 1x1x"):
        matched(unclear, ramp, ramp, "scale=none,output=c")


# ---- models and wishes that do not fit


@pytest.mark.parametrize(
    ("names", "sizes", "out", "complaint"),
    [
        (("a", "b", "c"), OPEN, OPEN, r"has 3 inputs \(a 1x3x\?x\?, .*\), but a stereo model has one"),
        (("left", "right"), (1, 5, 32, 32), (1, 5, 32, 32), "has no axis of 1 or 3 channels where 1 picture would go"),
        (("both",), (1, 3, 32, 32), (1, 3, 32, 32), "has no axis of 2 or 6 channels where 2 pictures would go"),
        (("left", "right"), (3, 32, 32), (3, 32, 32), "input left 3x32x32 .* is no picture: it must have four axes"),
        (("left", "right"), (2, 3, 32, 32), (2, 3, 32, 32), "the first .the batch. of size 1 or open"),
        (("left", "right"), (1, 3, 32, 48), (1, 3, 32, 48), None),
    ],
)
def test_a_model_that_takes_no_pair_is_refused(
    names: tuple[str, ...], sizes: tuple[int, ...], out: tuple[int, ...], complaint: str | None, tmp_path: Path
) -> None:
    nodes = [helper.make_node("Sum", list(names), ["disparity"])]
    model = shown(tmp_path / "model.onnx", names, sizes, out, nodes)
    if complaint is None:
        assert OnnxMatcher.named(f"onnx:{model},scale=none")
        return
    with pytest.raises(DataError, match=complaint):
        OnnxMatcher.named(f"onnx:{model},scale=none")


def test_a_model_with_no_map_is_refused_before_it_runs_and_after(ramp: np.ndarray, tmp_path: Path) -> None:
    means = [helper.make_node("ReduceMean", ["left"], ["depth"], axes=[2, 3], keepdims=0)]
    model = shown(tmp_path / "means.onnx", ("left", "right"), (1, 3, 96, 160), (1, 3), means, output="depth")
    with pytest.raises(DataError, match=r"no output of .*means.onnx \(depth 1x3\) is a map of 160x96 like its input"):
        OnnxMatcher.named(f"onnx:{model},scale=none")
    pooled = [helper.make_node("AveragePool", ["left"], ["disp"], kernel_shape=[2, 2], strides=[2, 2])]
    model = shown(tmp_path / "pooled.onnx", ("left", "right"), OPEN, (1, 3, "h", "w"), pooled, output="disp")
    with pytest.raises(DataError, match="gave an output of 1x3x48x80 for pictures of 160x96: a disparity map has"):
        matched(model, ramp, ramp)


def test_channels_that_are_not_there_or_not_said_are_asked_for(ramp: np.ndarray, tmp_path: Path) -> None:
    nodes = [helper.make_node("Identity", ["left"], ["disparity"])]
    open_sizes = (1, "c", "h", "w")
    model = shown(tmp_path / "open.onnx", ("left", "right"), open_sizes, open_sizes, nodes)
    with pytest.raises(UsageError, match=r"leaves its channels open: add channels=1 or channels=3"):
        matched(model, ramp, ramp)
    found = matched(model, ramp, ramp, "scale=none,channels=3,channel=2", labels=200)
    np.testing.assert_array_equal(found.disparity_px[:, 1:], ramp[:, 1:])
    with pytest.raises(DataError, match="channel=3, but there are 3, counted from 0"):
        matched(model, ramp, ramp, "scale=none,channels=3,channel=3")


def test_a_model_that_fails_on_a_picture_says_on_which(ramp: np.ndarray, tmp_path: Path) -> None:
    nodes = [helper.make_node("Reshape", ["left", "shape"], ["disparity"])]
    model = shown(
        tmp_path / "stiff.onnx", ("left", "right"), (1, 1, "h", "w"), (1, 64, 64), nodes,
        [constant("shape", [1, 64, 64], np.int64)],
    )  # fmt: skip
    with pytest.raises(DataError, match=r"stiff.onnx failed on left 1x1x96x160, right 1x1x96x160: .*add multiple=N"):
        matched(model, ramp, ramp)


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"there is no model file .*gone.onnx: give the path of an .onnx file"):
        OnnxMatcher.named(f"onnx:{tmp_path / 'gone.onnx'},scale=none")
    for content in (b"", b"not a model", b"\x08\x07" * 40):
        (tmp_path / "bad.onnx").write_bytes(content)
        with pytest.raises(DataError, match=r"bad.onnx is no model that onnxruntime can run"):
            OnnxMatcher.named(f"onnx:{tmp_path / 'bad.onnx'},scale=none")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("", r"nothing tells how .*m.onnx wants its pictures: add preset=NAME \(hitnet, .*\), or scale=none"),
        (",preset=magic", "there is no preset 'magic': choose one of hitnet, "),
        (",speed=9", "a learned matcher has no option 'speed': the options are preset, provider, check, scale, "),
        (",check=maybe", "check=maybe: give check=yes or check=no"),
        (",scale=loud", "option 'scale=loud' of .*m.onnx: Invalid enum value 'loud'"),
        (",scale=none,multiple=0", "multiple=0' of .*m.onnx: Expected `int` >= 1"),
        (",scale=none,provider=magic", "no provider 'magic': choose one of .*cpu"),
    ],
)
def test_a_wish_that_cannot_be_granted_says_what_can(options: str, complaint: str, tmp_path: Path) -> None:
    model = block_matcher(tmp_path / "m.onnx", 2)
    with pytest.raises(UsageError, match=complaint):
        OnnxMatcher.named(f"onnx:{model}{options}")


def test_a_name_without_a_model_shows_the_form() -> None:
    with pytest.raises(UsageError, match=r"matcher 'onnx:' names no model: give onnx:MODEL.onnx\[,preset=NAME\]"):
        OnnxMatcher.named("onnx:")


def test_providers_are_the_users_choice(pair: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    model = block_matcher(tmp_path / "blocks.onnx", 24)
    short, full = (matched(model, *pair, f"scale=none,provider={name}") for name in ("cpu", "CPUExecutionProvider"))
    np.testing.assert_array_equal(short.disparity_px, full.disparity_px)


# ---- presets


@pytest.mark.parametrize(
    ("file", "nodes", "preset"),
    [
        ("eth3d/saved_model_480x640/hitnet_eth3d_480x640.onnx", (), "hitnet-eth3d"),
        ("middlebury_d400/hitnet_middlebury_d400.onnx", (), "hitnet-middlebury"),
        ("model_float32.onnx", ("input", "reference_output_disparity"), "hitnet"),
        ("crestereo_combined_iter10_360x640.onnx", (), "crestereo"),
        ("acvnet_maxdisp192_sceneflow_384x640.onnx", (), "acvnet"),
        ("fast_acvnet_generalization_opset16_480x640.onnx", (), "acvnet"),
        ("cgi_stereo_sceneflow_480x640.onnx", (), "cgi-stereo"),
        ("coex_480x640.onnx", (), "coex"),
        ("MobileStereoNet/model_float32.onnx", (), "mobilestereonet"),
        ("any.onnx", ("left_img", "right_img", "disp_pred"), "lightstereo"),
        ("any.onnx", ("left_values", "right_values", "disparity"), "stereo-matching"),
        ("any.onnx", ("left", "right", "disparity"), None),
    ],
)
def test_families_are_known_by_their_file_names_and_nodes(
    file: str, nodes: tuple[str, ...], preset: str | None
) -> None:
    assert recognised(Path(file), nodes) == preset


def test_a_recognised_model_needs_no_words(ramp: np.ndarray, tmp_path: Path) -> None:
    """ACVNet's ImageNet scale by the file name alone: the model undoes it for the first channel, red."""
    model = shown(
        tmp_path / "acvnet_96x160.onnx", ("left", "right"), (1, 3, 96, 160), (1, 3, 96, 160),
        [helper.make_node("Mul", ["left", "span"], ["spread"]), helper.make_node("Add", ["spread", "offset"], ["disparity"])],
        [constant("span", 58.395), constant("offset", 123.675)],
    )  # fmt: skip
    matcher = OnnxMatcher.named(f"onnx:{model}")
    found = matcher.match(RectifiedPair(ramp, ramp, DisparityWindow(160))).disparity_px
    np.testing.assert_allclose(found[:, 1:], ramp[:, 1:], atol=1 / 16)


def test_every_preset_says_what_it_is_about_and_how_it_is_known() -> None:
    for name, preset in presets().items():
        assert preset.about, name
        assert preset.licence, name
        assert preset.words or preset.nodes, name
