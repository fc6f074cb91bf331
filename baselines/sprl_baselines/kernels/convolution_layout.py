"""How `convolution_loops` wants a network's weights: eight outputs side by side, all layers in one array."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from sprl_baselines.kernels.compiling import Array, Arrays, Offsets

TILE: Final = 8  # outputs of a convolution at a time


class Layout(NamedTuple):
    """The weights of all layers."""

    offsets: Offsets  # [layers + 2] the first plane of the images, of each layer, and what would be the next
    tiles: Array  # [layers, ...] each layer's weights `[ceil(O / 8), C, 4, 8]`, then zeros
    starts: Array  # [layers, ...] each layer's biases, then zeros


def layout(weights: Arrays, biases: Arrays) -> Layout:
    """Return the layout of weights, each `[O, C, 4]`, and biases, each `[O]`."""
    channels = [weights[0].shape[1], *(2 * len(weight) for weight in weights)]
    offsets = np.cumsum([0, *channels])
    return Layout(offsets, _rows(map(_tiles, weights)), _rows(biases, spare=TILE))


def tiles_back(weights: Arrays) -> Array:
    """Return each layer's weights for the way of gradients, `[ceil(C / 8), O, 4, 8]`, then zeros."""
    return _rows(_tiles(weight.transpose(1, 0, 2)) for weight in weights)


def _tiles(weight: Array) -> Array:
    outputs, channels, taps = weight.shape
    filled = np.zeros((-(-outputs // TILE) * TILE, channels, taps), np.float32)
    filled[:outputs] = weight
    return filled.reshape(-1, TILE, channels, taps).transpose(0, 2, 3, 1).ravel()


def _rows(arrays: Iterable[Array], spare: int = 0) -> Array:
    """Return flat arrays as rows with zeros behind, in the longest one at least `spare`."""
    listed = list(arrays)
    rows = np.zeros((len(listed), max(map(len, listed)) + spare), np.float32)
    for row, array in zip(rows, listed, strict=True):
        row[: len(array)] = array
    return rows
