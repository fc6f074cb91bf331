"""Each distinct observation once: repeats need not go through a network again.

Many steps of a grid world change nothing (a turn of the handle where there is no door, a walk into a wall), and short
episodes visit the same states again. What is computed is the same; how much is saved depends on the policy.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor


def distinct(rows: Tensor) -> tuple[Tensor, Tensor]:
    """Return the D distinct rows `[D, ...]` of `[B, ...]` in order of appearance, and each row's place there, `[B]`.

    Rows are the same if their bytes are.
    """
    seen: dict[bytes, int] = {}
    places = np.array([seen.setdefault(row.tobytes(), len(seen)) for row in rows.cpu().numpy()])
    first = np.unique(places, return_index=True)[1]
    return rows[torch.from_numpy(first).to(rows.device)], torch.from_numpy(places).to(rows.device)
