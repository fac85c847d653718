# SPDX-License-Identifier: Apache-2.0
"""Targets, and detection of their markers in images."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from . import _core
from .arrays import table
from .errors import InputError, JobError

if TYPE_CHECKING:
    from .arrays import PathLike, Table


class Target:
    """A calibration target: in one word, or from a file (target.yaml, or Kalibr's).

    >>> target = Target("chessboard:9x6:25mm")
    >>> len(target.markers)
    54
    >>> target.markers["position"][1]
    array([0.025, 0.   , 0.   ])
    """

    _native: _core.Target

    def __init__(self, target: PathLike) -> None:
        """Reads a target.

        Args:
            target: in one word ("chessboard:9x6:25mm", "aprilgrid:6x6:88mm:0.3", "charuco:5x7:36mm:18mm:6X6_250",
                "circles:10x7:25mm"), or a file.

        Raises `InputError`.
        """
        word = os.fspath(target)
        is_word = ":" in word and not os.path.exists(word)
        self._native = _core.Target.parse(word) if is_word else _core.Target.load(word)

    @classmethod
    def _of(cls, core: _core.Target) -> Target:
        target = cls.__new__(cls)
        target._native = core
        return target

    @property
    def markers(self) -> Table:
        """One row per marker: marker, position (3,), m."""
        return table(self._native.positions())

    @property
    def tolerance(self) -> float | None:
        """Standard deviation of a nominal coordinate, m; None: not stated."""
        return self._native.tolerance

    @property
    def yaml(self) -> str:
        """The text of its target.yaml."""
        return self._native.yaml


def detect(image: Any, target: Target | PathLike) -> Table:
    """The markers of a target in one image of an ordinary camera.

    Args:
        image: a file, or a gray image (H, W) of 8 or 16 bits.
        target: a `Target`, a target in one word, or a target's file.

    Returns one row per marker: marker, x, y (px, (0, 0) is the centre of the top-left pixel), sigma (of
    each coordinate, px). Raises `JobError` with the reason if the image does not show the target.
    (`calibrate` also corrects tags for the local distortion, which it estimates from all images.)
    """
    where = "image"
    if not isinstance(target, Target):
        target = Target(target)
    if isinstance(image, (str, os.PathLike)):
        where = os.fspath(image)
        found = _core.detect_file(where, target._native)
    else:
        import numpy as np

        try:
            pixels = np.asarray(image)
        except ValueError as error:
            raise InputError("image: expected a gray image, found rows of different lengths") from error
        if pixels.ndim != 2 or pixels.size == 0 or pixels.dtype not in (np.uint8, np.uint16):
            raise InputError(
                "image: expected a gray image of shape (H, W), uint8 or uint16, found "
                f"{pixels.dtype} of shape {pixels.shape}"
            )
        found = _core.detect_array(np.ascontiguousarray(pixels), target._native)
    columns, failure, _ = found
    if failure:
        raise JobError(f"{where}: {failure}")
    return table(columns)
