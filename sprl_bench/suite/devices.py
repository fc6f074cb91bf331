"""The devices that agents compute on: their names, and whether this machine has them."""

from __future__ import annotations

import importlib.util
import re


def resolve_device(device: str) -> str:
    """Return the device itself: "auto" is a GPU if there is one here.

    Raises:
        ValueError: There is no such name.
    """
    if not re.fullmatch(r"auto|cpu|cuda(:[0-9]+)?", device):
        raise ValueError(f"device is {device!r}; it must be auto, cpu, cuda or cuda:N, as in cuda:0.")
    if device != "auto":
        return device
    return "cuda" if _gpus() else "cpu"


def require_device(device: str) -> None:
    """Refuse a GPU that this machine does not have.

    Raises:
        ValueError: There is no such device here; the message lists those there are.
    """
    kind, _, number = resolve_device(device).partition(":")
    gpus = _gpus() if kind == "cuda" else 0
    if kind == "cuda" and int(number or 0) >= gpus:
        there = ", ".join(["auto", "cpu", *(f"cuda:{index}" for index in range(gpus))])
        raise ValueError(f"device is {device!r}; it must be one that torch finds here: {there}.")


def _gpus() -> int:
    """Return how many GPUs torch finds; 0 without torch."""
    if importlib.util.find_spec("torch") is None:
        return 0
    import torch  # noqa: PLC0415 - it loads slowly, and only this question needs it

    return torch.cuda.device_count() if torch.cuda.is_available() else 0
