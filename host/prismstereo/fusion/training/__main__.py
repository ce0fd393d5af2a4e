"""Train the side nets anew: python -m prismstereo.fusion.training -o side_nets.npz (a quarter of an hour on two cores)."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.training.cell_samples import gather
from prismstereo.fusion.training.fitting import Course, fit
from prismstereo.fusion.training.still_lifes import StillLife, still_life
from prismstereo.fusion.upsampling.side_net import COARSE, FINE
from prismstereo_hw.files import read_array, write_whole

logger = logging.getLogger("prismstereo.fusion.training")
SCENES = 36  # seeds 1 .. 36; others are free to judge by
SCALES = {COARSE: (3.0, 3.7125, 3.7125, 4.0, 4.5), FINE: (6.5, 7.2, 8.0, 8.0, 9.0, 10.0)}
HIDDEN = (64, 32)
SEED = 5


def lifes(folder: Path | None) -> Iterator[StillLife]:
    """Yield the still lifes to learn from; with a folder, those that are there are read and the others kept."""
    for seed in range(1, SCENES + 1):
        picture, disparity = (
            None if folder is None else folder / f"{seed}_{name}.npy" for name in ("picture", "disparity")
        )
        if picture is None or disparity is None:
            yield still_life(seed)
        elif picture.exists() and disparity.exists():
            yield StillLife(read_array(picture).astype(np.uint8), read_array(disparity).astype(np.float32))
        else:
            life = still_life(seed)
            write_whole(picture, _npy(life.picture))
            write_whole(disparity, _npy(life.disparity_px))
            yield life


def _npy(values: NDArray[np.generic]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=False)
    return buffer.getvalue()


@click.command()
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Where the nets go: .npz")
@click.option("--scenes", type=click.Path(path_type=Path), help="Folder that keeps the rendered scenes.")
def train(out: Path, scenes: Path | None) -> None:
    """Render the scenes, gather the cells, fit both nets and write them."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    held: dict[str, NDArray[np.generic]] = {}
    for side, scales in SCALES.items():
        samples = gather(lifes(scenes), scales, np.random.default_rng(SEED))
        logger.info("side %d: %d cells", side, len(samples.near))
        weights, biases = fit(samples, HIDDEN, Course(seed=SEED))
        widths = [weights[0].shape[0], *(len(bias) for bias in biases)]
        numbers = [part for weight, bias in zip(weights, biases, strict=True) for part in (weight.T.ravel(), bias)]
        held[f"layers_{side}"] = np.array(widths, np.int32)
        held[f"numbers_{side}"] = np.concatenate(numbers).astype(np.float32)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **held)
    write_whole(out, buffer.getvalue())


if __name__ == "__main__":
    train()
