"""The training behind the small net: scenes and fits that repeat, and learn what there is to learn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from host.fusion_scores import score
from prismstereo.fusion.training.cell_samples import Samples, gather, low_resolution
from prismstereo.fusion.training.fitting import Course, fit
from prismstereo.fusion.training.still_lifes import StillLife, still_life
from prismstereo.fusion.upsampling import upsample
from prismstereo.fusion.upsampling.side_net import COARSE, FINE, SideNet, read_nets
from prismstereo_hw.errors import DataError


@pytest.fixture(scope="module")
def life() -> StillLife:
    """A small still life of a seed that no net was trained on."""
    return still_life(2001, 280, 210)


def test_a_still_life_has_depth_edges_that_its_picture_shows(life: StillLife) -> None:
    jumps = np.abs(np.diff(life.disparity_px, axis=1)) > 3
    contrast = np.abs(np.diff(life.picture.astype(float), axis=1)).sum(2)

    assert 0.005 < jumps.mean() < 0.2
    assert contrast[jumps].mean() > 2 * contrast[~jumps].mean()


@pytest.mark.soak
def test_a_still_life_repeats_bit_by_bit(life: StillLife) -> None:
    again, other = still_life(2001, 280, 210), still_life(2002, 280, 210)

    np.testing.assert_array_equal(life.picture, again.picture)
    np.testing.assert_array_equal(life.disparity_px, again.disparity_px)
    assert not np.array_equal(life.disparity_px, other.disparity_px)


def test_the_net_beats_the_votes_and_both_nearest_on_a_still_life(life: StillLife) -> None:
    truth = np.ascontiguousarray(life.disparity_px[:208])
    low = low_resolution(truth, 4.0)
    nearest = np.kron(low, np.ones((4, 4), np.float32)) * 4

    net, votes = (upsample(low, life.picture[:208], method).disparity_px for method in ("edge-snap", "votes"))

    errors = [score(found, truth, 4.0).edge_percent for found in (net, votes, nearest)]
    assert errors == sorted(errors)
    assert errors[0] < 0.6 * errors[2]


def test_samples_are_the_votes_of_cells_and_the_side_that_is_really_there(life: StillLife) -> None:
    samples = gather(iter([life]), (4.0,), np.random.default_rng(1))

    assert samples.inputs.shape == (len(samples.near), 2 * 16 + 16)
    assert np.abs(samples.inputs).max() <= 1.5
    told = samples.weights > 0
    votes = samples.inputs[:, :16] + samples.inputs[:, 16:32]
    assert ((votes > 0) == (samples.near > 0))[told].mean() > 0.8


def test_a_fit_repeats_and_learns_a_rule() -> None:
    rng = np.random.default_rng(3)
    inputs = rng.normal(size=(4000, 48)).astype(np.float32)
    near = (inputs[:, :16] + inputs[:, 16:32] > 0).astype(np.float32)
    samples, course = Samples(inputs, near, np.ones_like(near)), Course(epochs=12, portion=200)

    (weights, biases), (again, _) = fit(samples, (32,), course), fit(samples, (32,), course)

    for one, other in zip(weights, again, strict=True):
        np.testing.assert_array_equal(one, other)
    found = np.maximum(inputs @ weights[0] + biases[0], 0) @ weights[1] + biases[1]
    assert ((found > 0) == (near > 0)).mean() > 0.85


def test_the_nets_that_are_shipped_are_small_and_whole() -> None:
    nets = read_nets()

    assert sorted(nets) == [COARSE, FINE]
    assert 5_000 < sum(net.numbers.size for net in nets.values()) < 20_000


@pytest.mark.parametrize(
    ("net", "complaint"),
    [
        ((4, [48, 60, 16], 0), "a net of widths .* does not go from 48 votes to 16 places in eights"),
        ((4, [48, 64, 16], 7), "has 4176 finite numbers, not 7"),
    ],
)
def test_a_net_that_does_not_fit_is_refused(net: tuple[int, list[int], int], complaint: str) -> None:
    side, widths, count = net

    with pytest.raises(DataError, match=complaint):
        SideNet(side, np.array(widths, np.int32), np.zeros(count, np.float32))


def test_a_file_that_holds_no_nets_is_refused(tmp_path: Path) -> None:
    (tmp_path / "nets.npz").write_bytes(b"PK nothing")

    with pytest.raises(DataError, match="does not hold the upsampler's nets"):
        read_nets(tmp_path / "nets.npz")
