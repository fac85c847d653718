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
    `try_models`, `compare` and `check_model`. A calibration calls Python for all points of a view
    at once. Derivatives are finite differences unless `jacobian` is given.

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

    def jacobian(self, params: Sequence[float], point: Sequence[Any]) -> tuple[Any, Any, Any]:
        """Optional. params: the parameters, numbers; point: arrays (K,) of x, y and z, m. Returns image points
        (K, 2), px, and their derivatives by the parameters (K, 2, P) and by the point (K, 2, 3). A model that
        returns (2,), (2, P) and (2, 3) of one point works too, but slower."""
        raise NotImplementedError

    def unproject(self, params: Sequence[float], pixel: Sequence[float]) -> Any:
        """Optional. Direction (3,), of any length, of the ray through one pixel (x, y, px) of a camera with
        params; NaN: no ray. The default inverts `project` numerically."""
        import numpy as np

        return self._invert(params, np.asarray(pixel, dtype=np.float64)[None])[0]

    def start(self, f: float, c_x: float, c_y: float) -> Iterable[Sequence[float]]:
        """Initial guesses: parameters whose projection near the axis is that of a pinhole camera with focal
        length f and principal point (c_x, c_y), px. The default takes the first four parameters for
        f_x, f_y, c_x, c_y and the neutral values of the others."""
        rest = [0.0 if param.neutral is None else param.neutral for param in self.params[4:]]
        return [(f, f, c_x, c_y, *rest)]

    #: Whether `jacobian` takes arrays of points
    _differentiates_arrays = False

    # Called by the extension module.

    def _project_rows(self, params: FloatArray, points: FloatArray) -> FloatArray:
        import numpy as np

        with np.errstate(all="ignore"):
            x, y = self.project(tuple(params.T), tuple(points.T))
        out = np.empty((len(points), 2))
        out[:, 0] = x
        out[:, 1] = y
        return out

    def _jacobian_rows(self, params: FloatArray, points: FloatArray) -> tuple[Any, Any, Any]:
        import numpy as np

        row = tuple(params[0])
        with np.errstate(all="ignore"):
            if self._differentiates_arrays:
                found = [self.jacobian(row, tuple(points.T))]
            else:
                found = [self.jacobian(row, tuple(point)) for point in points]
        return tuple(  # type: ignore[return-value]
            np.ascontiguousarray(np.asarray(values, dtype=np.float64).reshape(len(points), width))
            for values, width in zip(zip(*found), (2, 2 * len(self.params), 6))
        )

    def _unproject_rows(self, params: FloatArray, pixels: FloatArray) -> FloatArray:
        import numpy as np

        row = tuple(float(p) for p in params[0])
        with np.errstate(all="ignore"):
            if type(self).unproject is CameraModel.unproject:
                return self._invert(row, pixels)
            directions = [self.unproject(row, tuple(pixel)) for pixel in pixels]
        return np.ascontiguousarray(np.asarray(directions, dtype=np.float64).reshape(len(pixels), 3))

    def _starts(self, f: float, c_x: float, c_y: float) -> list[list[float]]:
        return [[float(value) for value in camera] for camera in self.start(f, c_x, c_y)]

    def _invert(self, params: Sequence[float], pixels: FloatArray) -> FloatArray:
        """Inverts `project` by Newton's method on the unit sphere, from the nearest of a set of directions."""
        import numpy as np

        rays = np.full((len(pixels), 3), np.nan)
        directions, images = self._table(tuple(params))
        if len(images) == 0 or len(pixels) == 0:
            return rays
        ray = np.empty_like(rays)
        for part in np.array_split(np.arange(len(pixels)), 1 + len(pixels) // 256):
            distance = np.sum((images - pixels[part, None]) ** 2, axis=2)
            ray[part] = directions[np.argmin(distance, axis=1)]

        def project(rays: FloatArray) -> FloatArray:
            return self._project_rows(np.repeat([params], len(rays), axis=0), rays)

        epsilon = np.finfo(float).eps
        step = np.cbrt(epsilon)
        rounding = 4 * epsilon * (1 + np.abs(pixels).max(axis=1))
        error = np.full(len(pixels), np.inf)
        open_ = np.arange(len(pixels))
        for _ in range(50):
            at = ray[open_]
            a = np.cross(at, np.eye(3)[np.argmin(np.abs(at), axis=1)])
            a /= np.linalg.norm(a, axis=1, keepdims=True)
            tangents = np.stack([a, np.cross(at, a)])
            u = project(np.concatenate([at, *(at + step * tangents), *(at - step * tangents)])).reshape(5, -1, 2)
            residual = pixels[open_] - u[0]
            error[open_] = np.linalg.norm(residual, axis=1)
            slope = np.moveaxis((u[1:3] - u[3:5]) / (2 * step), 0, -1)
            usable = np.isfinite(u).all(axis=(0, 2)) & (error[open_] > rounding[open_])
            usable &= np.abs(np.linalg.det(np.where(usable[:, None, None], slope, 0))) > 0
            open_, at, tangents = open_[usable], at[usable], tangents[:, usable]
            if len(open_) == 0:
                break
            delta = np.linalg.solve(slope[usable], residual[usable, :, None])[:, :, 0]
            # Half a radian at most, halved until the step stays in the domain and improves.
            delta *= np.minimum(1.0, 0.5 / np.maximum(np.linalg.norm(delta, axis=1), 1e-300))[:, None]
            move = np.einsum("ni,inj->nj", delta, tangents)
            left = np.arange(len(open_))
            for halving in range(30):
                moved = at[left] + 0.5**halving * move[left]
                moved /= np.linalg.norm(moved, axis=1, keepdims=True)
                errors = np.linalg.norm(pixels[open_[left]] - project(moved), axis=1)
                better = errors < error[open_[left]]
                ray[open_[left[better]]], error[open_[left[better]]] = moved[better], errors[better]
                left = left[~better]
                if len(left) == 0:
                    break
            open_ = np.delete(open_, left)
            if len(open_) == 0:
                break
        found = error < 1e-9 * (1 + np.abs(pixels).max(axis=1))  # of rounding
        rays[found] = ray[found]
        return rays

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


def _takes_arrays(model: CameraModel) -> bool:
    import numpy as np

    count, points = 3, ([0.1, -0.1, 0.2], [0.2, 0.1, -0.1], [1.0, 1.2, 0.9])
    try:
        with np.errstate(all="ignore"):
            found = model.jacobian(tuple(model.example), tuple(np.array(row) for row in points))
        shapes = tuple(np.shape(value) for value in found)
    except Exception:  # noqa: BLE001 - whatever a function of one point raises for arrays
        return False
    return shapes == ((count, 2), (count, 2, len(model.params)), (count, 2, 3))


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
    has_jacobian = model.jacobian is not CameraModel.jacobian
    instance._differentiates_arrays = has_jacobian and _takes_arrays(instance)
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
        has_jacobian,
    )
