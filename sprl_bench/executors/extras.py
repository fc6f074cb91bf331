"""Packages that only one executor needs."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["require_extra"]


def require_extra(module: str, extra: str | None = None) -> Any:
    """Import a package that only one executor needs.

    Raises:
        ModuleNotFoundError: It is not installed; the message says how to.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        raise ModuleNotFoundError(f"{module} is not installed: pip install 'sprl-bench[{extra or module}]'") from None
