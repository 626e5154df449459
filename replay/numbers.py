"""Numbers of an answer as JSON holds them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def rounded(content: Any) -> Any:
    """JSON content with all its numbers at six digits, more than a log can give; 0 where there is none."""
    if isinstance(content, float):
        if np.isfinite(content):
            return float(f"{content:.6g}")
        return 0.0
    if isinstance(content, Mapping):
        return {key: rounded(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [rounded(value) for value in content]
    return content
