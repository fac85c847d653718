# SPDX-License-Identifier: Apache-2.0
"""One camera: its model, parameters, pose and uncertainty; projections, comparison and conversion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Iterable, NamedTuple, Sequence

from . import _core
from .arrays import floats, pixels, table, transform
from .errors import InputError

if TYPE_CHECKING:
    from .arrays import FloatArray, Table


class Projection(NamedTuple):
    """Image points with derivatives; NaN where the model has no image point."""

    values: FloatArray  #: (N, M), px
    by_params: FloatArray  #: (N, M, P): by the camera's parameters
    by_point: FloatArray  #: (N, M, 3): by the point, px/m


class Rays(NamedTuple):
    """Rays origin + lambda * direction, lambda > 0, in the camera's frame; NaN where there is none."""

    origins: FloatArray  #: (N, 3), m
    directions: FloatArray  #: (N, 3), of length 1


class Difference(NamedTuple):
    """Difference of two calibrations of one camera (`plenocal compare`)."""

    T_b_a: FloatArray  #: (4, 4): motion of the camera's frame that is subtracted from the difference
    #: One row per distance: distance (m), points, rms and largest (px), predicted (px, from the
    #: covariances of both; NaN: not known), probability, differs
    distances: Table
    #: For each distance (K, 5): x, y, dx, dy, predicted, px
    pixels: list[FloatArray]
    same: bool | None  #: equal within the uncertainty of both; None: not known

    @property
    def rms(self) -> float:
        """RMS over the image at the first distance, px."""
        return float(self.distances["rms"][0])


class Conversion(NamedTuple):
    """A camera converted to another model (`plenocal convert`)."""

    camera: Camera
    rms: float  #: px
    largest: float  #: px
    unseen: int  #: pixels of a grid whose rays have no image point in the new model


class Camera:
    """A camera with parameters: of a `Calibration`, or made from numbers.

    Pixel (0, 0) is the centre of the top-left pixel; the camera looks along +z, x points right, y
    down; lengths are in metres.

    >>> camera = Camera("pinhole", (640, 480), [500.0, 500.0, 319.5, 239.5])
    >>> camera.project([[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.0, 0.0, -1.0]])
    array([[319.5, 239.5],
           [369.5, 239.5],
           [  nan,   nan]])
    >>> camera.unproject([[319.5, 239.5]])
    array([[0., 0., 1.]])
    """

    _native: _core.Camera

    def __init__(
        self,
        model: str,
        image_size: Sequence[int],
        params: Iterable[float],
        *,
        config: Iterable[float] = (),
        name: str = "camera",
        T_camera_rig: Any = None,
        covariance: Any = None,
    ) -> None:
        """A camera made from numbers.

        Args:
            model: name of the camera model (`plenocal.models()`).
            image_size: width and height, px.
            params: the model's parameters, in its order.
            config: constants that the model needs in addition (pixel_size of a plenoptic camera, m).
            name: name in the rig.
            T_camera_rig: (4, 4), p_camera = T_camera_rig p_rig, m; None: identity.
            covariance: (P, P) of params; None: zero.

        Raises `InputError`.
        """
        import numpy as np

        pose = np.eye(4) if T_camera_rig is None else transform(T_camera_rig, "T_camera_rig")
        values = _numbers(params, "params")
        if covariance is not None:
            covariance = floats(covariance, "covariance", len(values))
            is_square = len(covariance) == len(values)
            if not is_square or not np.allclose(covariance, covariance.T) or (np.diag(covariance) < 0).any():
                raise InputError("covariance: expected a symmetric matrix without negative variances")
        size = list(pixels(image_size, "image_size"))
        self._native = _core.Camera.make(
            str(name), str(model), size, values, _numbers(config, "config"), pose, covariance
        )

    @classmethod
    def _of(cls, core: _core.Camera) -> Camera:
        camera = cls.__new__(cls)
        camera._native = core
        return camera

    @property
    def name(self) -> str:
        """Name in the rig."""
        return self._native.name

    @property
    def model(self) -> str:
        """Name of the camera model."""
        return self._native.model

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height, px."""
        width, height = self._native.image_size
        return width, height

    @property
    def central(self) -> bool:
        """Whether all rays meet in one point."""
        return self.centre == "point"

    @property
    def centre(self) -> str:
        """Where all rays meet: "point", "axis" (the optical axis), "none"."""
        return self._native.centre

    @property
    def plenoptic(self) -> bool:
        """Whether observations are made through micro lenses."""
        return self._native.plenoptic

    @property
    def measured(self) -> list[str]:
        """Names of the M measured coordinates."""
        return self._native.measured

    @property
    def context(self) -> list[str]:
        """Names of the C other numbers of an observation: of a plenoptic camera the centre of the micro image, px."""
        return self._native.context

    @property
    def params(self) -> FloatArray:
        """(P,): the parameters, in the model's order."""
        return self._native.params

    @property
    def config(self) -> FloatArray:
        """Constants of the model that are not estimated (pixel_size of a plenoptic camera, m)."""
        return self._native.config

    @property
    def covariance(self) -> FloatArray:
        """(P, P): of the parameters; zero for fixed ones, infinite variance if not determined."""
        return self._native.covariance

    @property
    def parameters(self) -> Table:
        """Parameters as a table: name, value, sigma (standard error), unit."""
        import numpy as np

        names, units = zip(*self._native.names_and_units)
        sigma = np.sqrt(np.diag(self._native.covariance))
        return table({"name": names, "value": self._native.params, "sigma": sigma, "unit": units})

    @property
    def T_camera_rig(self) -> FloatArray:
        """(4, 4): p_camera = T_camera_rig p_rig, m."""
        return self._native.T_camera_rig

    @property
    def fit(self) -> dict[str, float]:
        """Points, rejected, views, rms (px), noise_sigma (px), detector_sigma (px) of its calibration."""
        return self._native.fit

    def project(self, points: Any, context: Any = None) -> FloatArray:
        """Image points (N, M), px; NaN where the model has none.

        Args:
            points: (N, 3), in the camera's frame, m.
            context: (N, C), for a plenoptic camera the centres of the micro images, px; None for an ordinary camera.

        Raises `InputError` for wrong shapes.
        """
        return self._native.project(floats(points, "points", 3), self._contexts(context, points))

    def unproject(self, pixels: Any, context: Any = None) -> FloatArray:
        """Unit vectors (N, 3) along the rays of image points; NaN: no ray.

        Args:
            pixels: image points (N, M), px.
            context: as of `project`.
        """
        return self.rays(pixels, context).directions

    def rays(self, pixels: Any, context: Any = None) -> Rays:
        """The rays of image points; NaN: no ray.

        Args:
            pixels: image points (N, M), px.
            context: as of `project`.
        """
        pixels = floats(pixels, "pixels", len(self.measured))
        return Rays(*self._native.rays(pixels, self._contexts(context, pixels)))

    def jacobian(self, points: Any, context: Any = None) -> Projection:
        """`project` with derivatives by parameters and points.

        Args:
            points: (N, 3), in the camera's frame, m.
            context: as of `project`.
        """
        points = floats(points, "points", 3)
        return Projection(*self._native.jacobian(points, self._contexts(context, points)))

    def uncertainty(self, points: Any, context: Any = None) -> FloatArray:
        """Covariances (N, M, M), px^2, of the projections of fixed points, by the covariance of the parameters.

        Computed to first order; infinite where a parameter that is not determined has an effect. A
        motion of the camera's frame can compensate most of it; `Calibration.projection_sigma` and
        `image_sigma` leave that part out.

        Args:
            points: (N, 3), in the camera's frame, m.
            context: as of `project`.
        """
        points = floats(points, "points", 3)
        return self._native.uncertainty(points, self._contexts(context, points))

    def image_sigma(self, distances: Sequence[float] = (1.0, float("inf"))) -> float:
        """Standard error of the projection, px: RMS over the image and the distances, less the
        part that a motion of the camera's frame compensates.

        Args:
            distances: of the scene, m, `inf` for far away.
        """
        return self._native.image_sigma(_distances(distances))

    def compare(
        self, other: Camera, distances: Sequence[float] = (1.0, float("inf"))
    ) -> Difference:
        """Difference of another calibration of this camera over the image (`plenocal compare`).

        Args:
            other: the camera in the other calibration, of any model.
            distances: of the scene, m, `inf` for far away.
        """
        found = self._native.compare(other._native, _distances(distances))
        rows = found["distances"]
        pixels = [row.pop("pixels") for row in rows]
        columns = {key: [row[key] for row in rows] for key in rows[0]}
        same = found["same"] if found["has_prediction"] else None
        return Difference(found["T_b_a"], table(columns), pixels, same)

    def convert(self, model: str) -> Conversion:
        """This camera with another model, fitted over the image (`plenocal convert`).

        Args:
            model: name of the other camera model.
        """
        camera, rms, largest, unseen = self._native.convert(model)
        return Conversion(Camera._of(camera), rms, largest, unseen)

    def _contexts(self, context: Any, points: Any) -> FloatArray | None:
        names = self._native.context
        if not names:
            if context is not None:
                raise InputError(f"context: {self.model} takes none")
            return None
        if context is None:
            raise InputError(f"context: {self.model} needs {', '.join(names)} of each point")
        rows = floats(context, "context", len(names))
        if len(rows) != len(points):
            raise InputError(f"context: expected {len(points)} rows, found {len(rows)}")
        return rows

    def _values(self, pixels: Any, context: Any, name: str = "pixels") -> FloatArray:
        """(N, M + C): pixels with their contexts."""
        import numpy as np

        rows = floats(pixels, name, len(self.measured))
        contexts = self._contexts(context, rows)
        return rows if contexts is None else np.hstack([rows, contexts])

    def __repr__(self) -> str:
        width, height = self.image_size
        return f"<plenocal.Camera {self.name}: {self.model}, {width} x {height} px>"


def _numbers(values: Any, name: str) -> list[float]:
    import numpy as np

    array = floats(values if hasattr(values, "__len__") else list(values), name) if _any(values) else None
    if array is None:
        return []
    if array.ndim != 1 or not np.isfinite(array).all():
        raise InputError(f"{name}: expected finite numbers in one row")
    return [float(value) for value in array]


def _any(values: Any) -> bool:
    return not hasattr(values, "__len__") or len(values) > 0


def _distances(distances: Sequence[float]) -> list[float]:
    found = [float(distance) for distance in distances]
    if not found or not all(distance > 0 for distance in found):
        raise InputError(f"distances: expected positive numbers of metres, or inf, found {distances}")
    return found
