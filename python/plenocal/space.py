# SPDX-License-Identifier: Apache-2.0
"""Points in space from their places in the images of calibrated cameras, with their standard errors."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Mapping, NamedTuple, Sequence

from . import _core
from .arrays import floats
from .calibration import Calibration
from .errors import InputError
from .program import Progress, caller

if TYPE_CHECKING:
    from .arrays import FloatArray, PathLike

_MOST = 10_000_000  # points


class Measured(NamedTuple):
    """A length (m) or an angle (rad) with its standard error."""

    value: float
    sigma: float  #: of all parts
    noise: float  #: part of sigma by noise of the images
    calibration: float  #: part by the calibration
    bias: float  #: that errors add to a length in the mean; contained in value
    low: float  #: interval of `level`
    high: float
    jitter: float  #: part of sigma by cameras that do not expose at once


class Plane(NamedTuple):
    """The plane normal . X = offset through points, by their whole covariance."""

    normal: FloatArray  #: (3,), towards the origin
    offset: float  #: m
    rms: float  #: of the points' distances from it, m
    chi_square: float
    degrees: int  #: number of points - 3
    probability: float  #: of a larger chi-square


class SpacePoints:
    """N points of `triangulate`, in the frame of the first camera of the call; NaN where there is none.

    All points of one calibration share its error: covariances of several need `shared`.
    """

    _native: _core.SpacePoints

    def __init__(self, native: _core.SpacePoints) -> None:
        """`native`: the result of the extension module."""
        self._native = native
        #: (N, 3), m; infinite for points at infinity.
        self.positions: FloatArray = native.positions().reshape(-1, 3)
        #: (N,): 1 / distance from the mean centre of the cameras that see it, 1/m.
        self.inverse_depth = native.inverse_depth()
        #: (N,): its standard error, 1/m.
        self.sigma_inverse_depth = native.sigma_inverse_depth()
        #: (N, 3, 3), m^2: covariance by the noise of the images.
        self.noise = native.noise()
        #: (3 N, P), m: root L of the calibration's part, rows x, y, z of each point: covariance L L^T.
        self.shared: FloatArray = _rows_of_three(native.shared())
        #: (N,): of residuals larger than its own, if its rays meet.
        self.probability = native.probability()
        #: (N,): found, and its rays meet.
        self.used = native.used().astype(bool)

    def __len__(self) -> int:
        return len(self._native)

    @property
    def rays(self) -> tuple[float, int, float]:
        """Chi-square, degrees of freedom and probability of all rays together: whether the calibration holds."""
        return self._native.rays()

    @property
    def findings(self) -> list[dict[str, Any]]:
        """What is wrong with all of them, as in `Calibration.verdict`."""
        found: list[dict[str, Any]] = json.loads(self._native.findings())
        return found

    @property
    def adjusted(self) -> dict[str, dict[str, float]]:
        """With `adjust`: of each number of the calibration `change`, and its standard error `sigma_before` and `sigma`."""
        numbers: dict[str, dict[str, float]] = json.loads(self._native.adjusted())
        return numbers

    def covariance(self, i: int, j: int) -> FloatArray:
        """(3, 3), m^2: covariance of the points of the indices i and j by all errors."""
        i, j = self._index(i), self._index(j)
        common: FloatArray = self.shared[3 * i : 3 * i + 3] @ self.shared[3 * j : 3 * j + 3].T
        return common + self.noise[i] if i == j else common

    def length(self, i: int, j: int) -> Measured:
        """Distance of the points of the indices i and j, m. Raises `InputError` where one is not there."""
        self._differ(i, j)
        return Measured(*self._native.length(self._index(i), self._index(j)))

    def angle(self, i: int, j: int, k: int) -> Measured:
        """Angle at the point of index j between those of i and k, rad. Raises `InputError` where one is not there."""
        self._differ(i, j, k)
        return Measured(*self._native.angle(self._index(i), self._index(j), self._index(k)))

    def plane(self, points: Sequence[int]) -> Plane:
        """The plane through the points of these indices, three or more. Raises `InputError` where one is not there, and
        for points on a line."""
        self._differ(*points)
        return Plane(*self._native.plane([self._index(i) for i in points]))

    def _index(self, i: int) -> int:
        if not -len(self) <= i < len(self):
            raise InputError(f"point {i}: there are {len(self)}")
        return int(i) % len(self)

    def _differ(self, *points: int) -> None:
        if len({self._index(i) for i in points}) < len(points):
            raise InputError(f"expected different points, found {points}")

    def __repr__(self) -> str:
        return f"<plenocal.SpacePoints {len(self)}, {int(self.used.sum())} used>"


def triangulate(
    calibration: Calibration | PathLike,
    pixels: Mapping[str, Any],
    *,
    context: Mapping[str, Any] | None = None,
    index: Mapping[str, Any] | None = None,
    sigma: float | Mapping[str, Any] | None = None,
    correlation: float = 0,
    adjust: bool = False,
    frame: str = "rig",
    level: float = 0.95,
    threads: int = 0,
    progress: Progress | None = None,
) -> SpacePoints:
    """Points in space from their places in images of one instant (`plenocal triangulate`, docs/space.md).

    Args:
        calibration: a `Calibration`, the folder that `calibrate` wrote, or a calibration.yaml.
        pixels: for each camera its image points (N, M), px: row i shows point i; NaN: not seen.
        context: for each plenoptic camera the centres of the micro images (R, C), px.
        index: for cameras whose R rows show other points than 0 to N - 1: the point of each row, (R,). A plenoptic
            camera has several rows of one point, as its table of detections.
        sigma: standard deviation of each coordinate, px: one number, or for each camera those of its rows (R,); None: the
            calibration's noise.
        correlation: of the noise of one coordinate between two ordinary cameras, for points that were matched from image
            to image.
        adjust: adjust the calibration, too, within its standard errors, by the rays of all points.
        frame: "rig": errors in the first camera's frame as calibrated; "housing": less the rigid motion by which the
            calibration's own points follow its errors.
        level: of intervals.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Raises `InputError`, and `JobError` if no point is found.
    """
    import numpy as np

    if frame not in ("rig", "housing"):
        raise InputError(f"frame: expected 'rig' or 'housing', found '{frame}'")
    if not 0 < level < 1:
        raise InputError(f"level: expected a number between 0 and 1, found {level}")
    calibration = calibration if isinstance(calibration, Calibration) else Calibration(os.fspath(calibration))
    sigmas = sigma if isinstance(sigma, Mapping) else dict.fromkeys(pixels, sigma)
    unknown = (set(context or ()) | set(index or ()) | set(sigmas)) - set(pixels)
    if unknown:
        raise InputError(f"context, index, sigma: no pixels of {', '.join(sorted(map(str, unknown)))}")
    seen, count = [], 0
    for name, places in pixels.items():
        try:
            camera = calibration[str(name)]
        except KeyError as error:
            raise InputError(f"pixels: {error.args[0]}") from error
        values = camera._values(places, (context or {}).get(name), f"pixels: {name}")
        numbers = np.arange(len(values)) if name not in (index or {}) else np.asarray((index or {})[name])
        fits = numbers.dtype.kind in "iu" and numbers.shape == (len(values),)
        if not fits or not ((numbers >= 0) & (numbers < _MOST)).all():
            raise InputError(f"index: {name}: expected {len(values)} numbers of points, from 0 to {_MOST - 1}")
        count = max(count, int(numbers.max(initial=-1)) + 1)
        here = np.isfinite(values).all(axis=1)
        noise = _noise(sigmas.get(name), here, str(name))
        values, numbers = np.ascontiguousarray(values[here]), numbers[here]
        images = np.column_stack([numbers, values[:, len(camera.measured) :]])
        if len(np.unique(images, axis=0)) < len(images):
            raise InputError(f"index: {name}: a point is twice in one {'micro ' if camera.plenoptic else ''}image")
        seen.append((str(name), values, numbers.tolist(), noise))
    native = _core.triangulate(
        calibration._native, seen, count, float(correlation), frame == "housing", adjust, level, caller(threads, progress)
    )
    return SpacePoints(native)


def _noise(sigma: Any, here: Any, name: str) -> list[float]:
    """Of the rows that are here, px; empty: the calibration's."""
    import numpy as np

    if sigma is None:
        return []
    try:
        noise = np.broadcast_to(np.asarray(sigma, float), here.shape)[here]
    except ValueError:
        noise = np.array([np.nan])
    if not ((noise > 0) & (noise < np.inf)).all():
        raise InputError(f"sigma: {name}: expected a positive number of pixels, or {len(here)} of them, found {sigma}")
    return [float(each) for each in noise]


def _rows_of_three(blocks: FloatArray) -> FloatArray:
    return blocks.reshape(-1, blocks.shape[2])
