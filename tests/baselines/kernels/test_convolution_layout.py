"""Where weights lie for the compiled convolutions."""

from __future__ import annotations

import numpy as np

from sprl_baselines.kernels.convolution_layout import TILE, layout, tiles_back


def test_weights_of_eight_outputs_lie_side_by_side() -> None:
    first, second = np.random.default_rng(0).normal(size=(2, 9, 18, 4)).astype(np.float32)
    first = first[:, :3]
    laid = layout((first, second), (first[:, 0, 0], second[:, 0, 0]))
    assert laid.offsets.tolist() == [0, 3, 21, 39]
    assert laid.tiles[0, ((1 * 3 + 2) * 4 + 3) * TILE + 0] == first[8, 2, 3]
    assert laid.tiles[1, ((0 * 18 + 17) * 4 + 1) * TILE + 7] == second[7, 17, 1]
    assert not laid.tiles[0, 2 * 3 * 4 * TILE :].any()
    assert laid.starts[1].tolist() == [*second[:, 0, 0], *[0] * TILE]
    assert tiles_back((first, second))[1, ((2 * 9 + 8) * 4 + 3) * TILE + 1] == second[8, 17, 3]
