# SPDX-License-Identifier: Apache-2.0
"""The notebook runs, and its pictures show what they should."""

from __future__ import annotations

import json
from typing import Any

import matplotlib
import numpy as np
import pytest

from conftest import ROOT


def test_the_gallery_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    matplotlib.use("Agg")
    folder = ROOT / "examples/python"
    monkeypatch.chdir(folder)
    notebook = json.loads((folder / "gallery.ipynb").read_text())
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]  # pictures are not in the repository
            exec(cell["source"], names)
    sigma = names["sigma"]
    height, width = sigma.shape
    assert sigma[height // 2, width // 2] < sigma[0, 0]
    assert {row["model"] for row in names["trials"]} == set(names["models"])
    focused, depth = names["pictures"]
    assert focused.std() > 30  # tags
    assert np.isfinite(depth).mean() > 0.8
    # The board is at 0.36 to 0.5 m: a virtual depth near 3.2.
    assert 2.5 < np.nanmedian(depth) < 4.5
