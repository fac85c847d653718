# SPDX-License-Identifier: Apache-2.0
"""Camera models written in Python."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import TYPE_CHECKING, Any, ClassVar, Iterable, Sequence, TypeVar

from . import _core
from .errors import InputError

if TYPE_CHECKING:
    from .arrays import FloatArray

_FIXED = ("never", "against_poses", "always")


@dataclasses.dataclass(frozen=True)
class Param:
    """A parameter of a camera model.

    Args:
        name: symbol of the paper, as in calibration.yaml.
        unit: "px", "m" or "1".
        lower: lower limit of its value, exclusive.
        upper: upper limit of its value, exclusive.
        scale: characteristic size; a change by this much gives a different camera.
        neutral: value without effect; None: there is none.
        fixed: "never", "against_poses" (a motion of the camera has the same effect) or "always".
        prior_sigma: for one of many coefficients: standard deviation of the Gaussian prior around 0; 0: none.
    """

    name: str
    unit: str = "1"
    lower: float = -math.inf
    upper: float = math.inf
    scale: float = 0.0
    neutral: float | None = None
    fixed: str = "never"
    prior_sigma: float = 0.0


#: f_x, f_y, c_x, c_y, px
INTRINSICS = (Param("f_x", "px", 0), Param("f_y", "px", 0), Param("c_x", "px"), Param("c_y", "px"))


class CameraModel:
    """Base class for a model of an ordinary camera in Python, to try an idea.

    Write `project` in numpy, then `register` the class. The model then works in sessions, `calibrate`,
    `try_models`, `compare` and `check_model`, but slower than the built-in ones: a calibration
    calls Python for each point. Derivatives are finite differences unless `jacobian` is given.

    >>> class Quadratic(CameraModel):
    ...     name = "quadratic"
    ...     params = (*INTRINSICS, Param("k", scale=1, neutral=0))
    ...     example = (410, 405, 322, 243, -0.1)
    ...
    ...     def project(self, params, point):
    ...         f_x, f_y, c_x, c_y, k = params
    ...         x, y = point[0] / point[2], point[1] / point[2]
    ...         s = 1 + k * (x * x + y * y)
    ...         inside = (point[2] > 0) & (1 + 3 * k * (x * x + y * y) > 0)
    ...         return np.where(inside, f_x * s * x + c_x, np.nan), f_y * s * y + c_y
    >>> register(Quadratic)
    >>> camera = plenocal.Camera("quadratic", (640, 480), Quadratic.example)
    >>> camera.project([[0.0, 0.0, 1.0]])
    array([[322., 243.]])
    """

    #: Name in sessions: a to z, 0 to 9, "-"
    name: ClassVar[str]
    #: Source of its equations
    source: ClassVar[str] = "a model in Python"
    #: Its parameters
    params: ClassVar[Sequence[Param]]
    #: Parameters of an example, and width and height of its image, for checks
    example: ClassVar[Sequence[float]]
    example_size: ClassVar[tuple[int, int]] = (640, 480)

    def project(self, params: Sequence[Any], point: Sequence[Any]) -> tuple[Any, Any]:
        """Returns x and y, px, of points. params: the parameters; point: x, y and z in the camera's frame,
        m. All of them and the results are arrays of one shape (K,). NaN outside of the model's domain."""
        raise NotImplementedError(f"{type(self).__name__}: project is missing")

    def jacobian(self, params: Sequence[float], point: Sequence[float]) -> tuple[Any, Any, Any]:
        """Optional. For one point (x, y, z, m) and params returns the image point (2,), px, and its
        derivatives by the parameters (2, P) and by the point (2, 3)."""
        raise NotImplementedError

    def unproject(self, params: Sequence[float], pixel: Sequence[float]) -> Any:
        """Optional. Direction (3,), of any length, of the ray through one pixel (x, y, px) of a camera with
        params; NaN: no ray. The default inverts `project` numerically."""
        return self._invert(params, pixel)

    def start(self, f: float, c_x: float, c_y: float) -> Iterable[Sequence[float]]:
        """Initial guesses: parameters whose projection near the axis is that of a pinhole camera with focal
        length f and principal point (c_x, c_y), px. The default takes the first four parameters for
        f_x, f_y, c_x, c_y and the neutral values of the others."""
        rest = [0.0 if param.neutral is None else param.neutral for param in self.params[4:]]
        return [(f, f, c_x, c_y, *rest)]

    # Called by the extension module.

    def _project_rows(self, params: FloatArray, points: FloatArray) -> FloatArray:
        import numpy as np

        with np.errstate(all="ignore"):
            x, y = self.project(tuple(params.T), tuple(points.T))
        out = np.empty((len(points), 2))
        out[:, 0] = x
        out[:, 1] = y
        return out

    def _jacobian_row(self, params: FloatArray, points: FloatArray) -> tuple[Any, Any, Any]:
        import numpy as np

        with np.errstate(all="ignore"):
            found = self.jacobian(tuple(params[0]), tuple(points[0]))
        shapes = ((1, 2), (2, len(self.params)), (2, 3))
        u, by_params, by_point = (
            np.ascontiguousarray(np.asarray(value, dtype=np.float64).reshape(shape))
            for value, shape in zip(found, shapes)
        )
        return u, by_params, by_point

    def _unproject_rows(self, params: FloatArray, pixels: FloatArray) -> FloatArray:
        import numpy as np

        with np.errstate(all="ignore"):
            direction = self.unproject(tuple(params[0]), tuple(pixels[0]))
        return np.ascontiguousarray(np.asarray(direction, dtype=np.float64).reshape(1, 3))

    def _starts(self, f: float, c_x: float, c_y: float) -> list[list[float]]:
        return [[float(value) for value in camera] for camera in self.start(f, c_x, c_y)]

    def _invert(self, params: Sequence[float], pixel: Sequence[float]) -> FloatArray:
        """Inverts `project` by Newton's method on the unit sphere, from the nearest of a set of directions."""
        import numpy as np

        directions, images = self._table(tuple(float(p) for p in params))
        target = np.asarray(pixel, dtype=np.float64)
        distance = np.sum((images - target) ** 2, axis=1)
        if not np.isfinite(distance).any():
            return np.full(3, np.nan)
        ray = directions[np.nanargmin(distance)]
        row = np.asarray(params, dtype=np.float64)[None]
        halves = 0.5 ** np.arange(30)
        rows = np.repeat(row, len(halves), axis=0)
        step = np.cbrt(np.finfo(float).eps)
        error = np.inf
        for _ in range(50):
            a = np.cross(ray, np.eye(3)[np.argmin(np.abs(ray))])
            a /= np.linalg.norm(a)
            tangents = np.stack([a, np.cross(ray, a)])
            rays = np.concatenate([ray[None], ray + step * tangents, ray - step * tangents])
            u = self._project_rows(np.repeat(row, 5, axis=0), rays)
            residual = target - u[0]
            error = float(np.linalg.norm(residual))
            if not np.isfinite(u).all() or error == 0:
                break
            slope = ((u[1:3] - u[3:5]) / (2 * step)).T
            try:
                delta = np.linalg.solve(slope, residual)
            except np.linalg.LinAlgError:
                break
            # Half a radian at most, halved until the step stays in the domain and improves.
            delta *= min(1.0, 0.5 / max(float(np.linalg.norm(delta)), 1e-300))
            moved = ray + halves[:, None] * (delta @ tangents)
            moved /= np.linalg.norm(moved, axis=1, keepdims=True)
            errors = np.linalg.norm(target - self._project_rows(rows, moved), axis=1)
            better = np.flatnonzero(errors < error)
            if len(better) == 0:
                break
            ray, error = moved[better[0]], float(errors[better[0]])
        tolerance = 1e-9 * (1 + float(np.abs(target).max()))  # of rounding
        return ray if error < tolerance else np.full(3, np.nan)

    def _table(self, params: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
        """Directions over the whole sphere and their image points; cached for the latest `params`."""
        import numpy as np

        known: tuple[tuple[float, ...], FloatArray, FloatArray] | None
        known = getattr(self, "_known_table", None)
        if known is not None and known[0] == params:
            return known[1], known[2]
        # Spirals of equal areas (Gonzalez 2010).
        count = 4000
        k = np.arange(count)
        z = 1 - (2 * k + 1) / count
        angle = math.pi * (3 - math.sqrt(5)) * k
        r = np.sqrt(1 - z * z)
        directions = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
        images = self._project_rows(np.repeat([params], count, axis=0), directions)
        inside = np.isfinite(images).all(axis=1)
        self._known_table = (params, directions[inside], images[inside])
        return directions[inside], images[inside]


M = TypeVar("M", bound=type[CameraModel])


def register(model: M) -> None:
    """Adds a camera model to this process; it cannot be removed.

    Args:
        model: a subclass of `CameraModel`.

    Raises `InputError` if a member is missing or the name is in use.
    """
    where = model.__name__
    for attribute in ("name", "params", "example"):
        if not hasattr(model, attribute):
            raise InputError(f"{where}: the class needs '{attribute}'")
    if not re.fullmatch("[a-z0-9-]+", model.name):
        raise InputError(f"{where}: name: expected letters a to z, digits and '-', found {model.name!r}")
    params = list(model.params)
    if not params or len({param.name for param in params}) < len(params):
        raise InputError(f"{where}: params: expected parameters with different names")
    if len(params) != len(model.example):
        raise InputError(f"{where}: example: expected {len(params)} values, found {len(model.example)}")
    for param, value in zip(params, model.example):
        if param.fixed not in _FIXED:
            raise InputError(f"{where}: {param.name}: fixed is one of {', '.join(_FIXED)}")
        if not param.lower < value < param.upper:
            raise InputError(f"{where}: example: {param.name} = {value} is outside of its limits")
    instance = model()
    _core.register_model(
        instance,
        model.name,
        model.source,
        [
            (p.name, p.unit, p.lower, p.upper, p.scale, p.neutral, _FIXED.index(p.fixed), p.prior_sigma)
            for p in params
        ],
        [float(value) for value in model.example],
        [int(value) for value in model.example_size],
        model.jacobian is not CameraModel.jacobian,
    )
