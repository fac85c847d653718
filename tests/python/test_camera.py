# SPDX-License-Identifier: Apache-2.0
"""Cameras against formulas written down here, without plenocal."""

from __future__ import annotations

import pathlib
import re
from typing import Any, Callable

import numpy as np
import numpy.typing as npt
import pytest

import plenocal

F = npt.NDArray[np.float64]
Lens = Callable[[F, F], Any]


def _pinhole(p: F, k: F) -> Any:
    return p[:, :2] / p[:, 2:]


def _radtan(p: F, k: F) -> Any:
    """Brown (1966) as OpenCV documents it: k_1 k_2 p_1 p_2 k_3 ... k_6 s_1 ... s_4."""
    k = np.concatenate([k, np.zeros(12 - len(k))])
    x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
    r2 = x * x + y * y
    radial = (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (
        1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    )
    u = x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x) + k[8] * r2 + k[9] * r2 * r2
    v = y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y + k[10] * r2 + k[11] * r2 * r2
    return np.stack([u, v], axis=1)


def _kannala_brandt4(p: F, k: F) -> Any:
    """Kannala and Brandt (2006), eq. (6), as cv::fisheye has it."""
    r = np.hypot(p[:, 0], p[:, 1])
    t = np.arctan2(r, p[:, 2])
    d = t * (1 + k[0] * t**2 + k[1] * t**4 + k[2] * t**6 + k[3] * t**8)
    return p[:, :2] * (d / r)[:, None]


def _ucm(p: F, k: F) -> Any:
    """Usenko et al. (2018), eq. (13): alpha."""
    d = np.linalg.norm(p, axis=1)
    return p[:, :2] / (k[0] * d + (1 - k[0]) * p[:, 2])[:, None]


def _eucm(p: F, k: F) -> Any:
    """Usenko et al. (2018), eq. (17): alpha, beta."""
    d = np.sqrt(k[1] * (p[:, 0] ** 2 + p[:, 1] ** 2) + p[:, 2] ** 2)
    return p[:, :2] / (k[0] * d + (1 - k[0]) * p[:, 2])[:, None]


def _double_sphere(p: F, k: F) -> Any:
    """Usenko et al. (2018), eq. (40): xi, alpha."""
    xi, alpha = k
    d1 = np.linalg.norm(p, axis=1)
    z = xi * d1 + p[:, 2]
    d2 = np.sqrt(p[:, 0] ** 2 + p[:, 1] ** 2 + z * z)
    return p[:, :2] / (alpha * d2 + (1 - alpha) * z)[:, None]


def _fov(p: F, k: F) -> Any:
    """Devernay and Faugeras (2001), eq. (13): omega."""
    r = np.hypot(p[:, 0], p[:, 1]) / p[:, 2]
    d = np.arctan(2 * r * np.tan(k[0] / 2)) / k[0]
    return p[:, :2] / p[:, 2:] * (d / r)[:, None]


def _radial3(p: F, k: F) -> Any:
    """Zeller et al.: A_0 A_1 A_2."""
    m = p[:, :2] / p[:, 2:]
    r2 = np.sum(m * m, axis=1)
    return m * (1 + k[0] * r2 + k[1] * r2**2 + k[2] * r2**3)[:, None]


def _division(p: F, k: F) -> Any:
    """Fitzgibbon (2001), inverted: lambda."""
    r2 = np.sum(p[:, :2] ** 2, axis=1)
    return 2 * p[:, :2] / (p[:, 2] + np.sqrt(p[:, 2] ** 2 - 4 * k[0] * r2))[:, None]


def _spherical(p: F, k: F) -> Any:
    """Snyder, section 12."""
    longitude = np.arctan2(p[:, 0], p[:, 2])
    return np.stack([longitude, np.arcsin(p[:, 1] / np.linalg.norm(p, axis=1))], axis=1)


LENSES: dict[str, Lens] = {
    "pinhole": _pinhole,
    "pinhole-radtan": _radtan,
    "pinhole-radtan4": _radtan,
    "pinhole-radtan8": _radtan,
    "pinhole-radtan12": _radtan,
    "kannala-brandt4": _kannala_brandt4,
    "ucm": _ucm,
    "eucm": _eucm,
    "double-sphere": _double_sphere,
    "fov": _fov,
    "pinhole-radial3": _radial3,
    "division": _division,
    "spherical": _spherical,
}


def example(model: str) -> plenocal.Camera:
    info = plenocal.model_info(model)
    return plenocal.Camera(
        model, info["example_size"], info["example"], config=info["example_config"]
    )


def points(count: int = 200) -> F:
    rng = np.random.default_rng(7)
    direction = np.stack(
        [rng.uniform(-0.5, 0.5, count), rng.uniform(-0.4, 0.4, count), np.ones(count)], axis=1
    )
    return direction * rng.uniform(0.3, 3, (count, 1))


@pytest.mark.parametrize("model", LENSES)
def test_projects_as_its_formula(model: str) -> None:
    camera, p = example(model), points()
    f_x, f_y, c_x, c_y, *k = camera.params
    expected = LENSES[model](p, np.array(k)) * [f_x, f_y] + [c_x, c_y]
    found = camera.project(p)
    inside = np.isfinite(found).all(axis=1)
    assert inside.sum() > 100
    np.testing.assert_allclose(found[inside], expected[inside], rtol=0, atol=1e-9)


@pytest.mark.parametrize("model", ["focused-plenoptic", "focused-plenoptic-pupil"])
def test_projects_through_micro_lenses_as_the_paper_has_it(model: str) -> None:
    """Zeller et al., "Plenoptic Camera Model", eqs. projected_micro_lens to _4_new, as they stand."""
    camera = example(model)
    f_L, b_L0, B, c_x, c_y, A_0, A_1, B_0, B_1, *b_P = camera.params
    pupil = b_P[0] if b_P else b_L0
    pixel_size = camera.config[0]

    def distorted(m: F) -> Any:
        x, y = m.T
        r2 = x * x + y * y
        radial = A_0 * r2 + A_1 * r2 * r2
        return np.stack(
            [
                x + x * radial + B_0 * (r2 + 2 * x * x) + 2 * B_1 * x * y,
                y + y * radial + B_1 * (r2 + 2 * y * y) + 2 * B_0 * x * y,
            ],
            axis=1,
        )

    rng = np.random.default_rng(11)
    centres = rng.uniform(50, 730, (100, 2))
    p = rng.uniform([-0.05, -0.05, 0.4], [0.05, 0.05, 1.5], (100, 3))
    c_Id = (centres - [c_x, c_y]) * pixel_size
    c_I = c_Id.copy()
    for _ in range(100):
        c_I += c_Id - distorted(c_I)
    c_ML = c_I * pupil / (pupil + B)
    p_ML = c_ML * f_L / (b_L0 - f_L)
    z_C0 = f_L * b_L0 / (f_L - b_L0)
    x_p = (p[:, :2] - p_ML) / (p[:, 2:] + z_C0)
    x_ML = x_p * f_L * B / (f_L - b_L0) - c_ML * B / (f_L - b_L0)
    expected = distorted(x_ML + c_ML) / pixel_size + [c_x, c_y]
    found = camera.project(p, centres)
    inside = np.isfinite(found).all(axis=1)
    assert inside.sum() > 80
    np.testing.assert_allclose(found[inside], expected[inside], rtol=0, atol=1e-6)


def context_of(camera: plenocal.Camera, count: int) -> F | None:
    if not camera.context:
        return None
    return np.tile(np.array(camera.image_size) / 2.0, (count, 1))


@pytest.mark.parametrize("model", plenocal.models())
def test_every_model_has_inverse_and_derivatives(model: str) -> None:
    camera, p = example(model), points(60)
    context = context_of(camera, len(p))
    pixels = camera.project(p, context)
    inside = np.isfinite(pixels).all(axis=1)
    assert inside.sum() > 30
    p, pixels = p[inside], pixels[inside]
    context = None if context is None else context[inside]
    # The point lies on its ray.
    rays = camera.rays(pixels, context)
    offset = p - rays.origins
    along = np.sum(offset * rays.directions, axis=1, keepdims=True)
    np.testing.assert_allclose(offset, along * rays.directions, atol=1e-6)
    if camera.central:
        np.testing.assert_array_equal(camera.unproject(pixels), rays.directions)
    # Derivatives by the point are those of differences.
    values, by_params, by_point = camera.jacobian(p, context)
    np.testing.assert_allclose(values, pixels, rtol=0, atol=1e-9)  # another order of operations
    assert by_params.shape == (len(p), len(camera.measured), len(camera.params))
    h = 1e-6
    for axis in range(3):
        step = h * np.eye(3)[axis]
        slope = (camera.project(p + step, context) - camera.project(p - step, context)) / (2 * h)
        np.testing.assert_allclose(by_point[..., axis], slope, rtol=1e-4, atol=1e-2)


def test_uncertainty_is_that_of_sampled_cameras() -> None:
    sigma = np.diag([0.5, 0.6, 0.3, 0.2]) ** 2
    camera = plenocal.Camera("pinhole", (640, 480), [500, 500, 320, 240], covariance=sigma)
    p = points(5)
    covariance = camera.uncertainty(p)
    assert covariance.shape == (5, 2, 2)
    rng = np.random.default_rng(3)
    samples = np.array(
        [
            plenocal.Camera("pinhole", (640, 480), params).project(p)
            for params in rng.multivariate_normal(camera.params, sigma, 4000)
        ]
    )
    # 4000 samples give a variance within 2.2 % (one standard deviation).
    np.testing.assert_allclose(samples.var(axis=0), np.diagonal(covariance, axis1=1, axis2=2), rtol=0.1)


def test_a_parameter_that_is_not_determined_makes_projections_uncertain() -> None:
    sigma = np.diag([np.inf, 0.0, 0.0, 0.0])
    for wrong in (-np.eye(4), np.full((4, 4), np.nan), np.triu(np.ones((4, 4)))):
        with pytest.raises(plenocal.InputError, match="covariance: expected a symmetric matrix"):
            plenocal.Camera("pinhole", (640, 480), [500, 500, 320, 240], covariance=wrong)
    camera = plenocal.Camera("pinhole", (640, 480), [500, 500, 320, 240], covariance=sigma)
    covariance = camera.uncertainty([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0]])
    assert np.isinf(covariance[0, 0, 0])
    assert (covariance[1] == 0).all()


def test_compare_and_convert() -> None:
    camera = example("pinhole-radtan")
    converted = camera.convert("pinhole-radtan8")
    assert converted.rms < 1e-6
    difference = camera.compare(converted.camera)
    assert difference.distances["largest"].max() < 1e-4
    assert difference.same is None


def test_arrays_are_taken_without_copies_and_others_converted() -> None:
    camera = example("pinhole")
    p = points(10)
    expected = camera.project(p)
    np.testing.assert_array_equal(camera.project(p.tolist()), expected)
    np.testing.assert_array_equal(camera.project(np.asfortranarray(p)), expected)
    np.testing.assert_array_equal(camera.project(p[::2]), expected[::2])
    np.testing.assert_array_equal(camera.project(np.zeros((0, 3))), np.zeros((0, 2)))
    single = p.astype(np.float32)
    np.testing.assert_array_equal(camera.project(single), camera.project(single.astype(float)))


@pytest.mark.parametrize(
    "wrong, message",
    [
        ([[1.0, 2.0]], r"points: expected an array of shape \(N, 3\), found shape \(1, 2\)"),
        ([1.0, 2.0, 3.0], r"found shape \(3,\)"),
        ([["a", "b", "c"]], "of real numbers, found <U1"),
        ([[1j, 0, 1]], "of real numbers, found complex128"),
        ([[1.0, 2.0, 3.0], [1.0]], "rows of different lengths"),
    ],
)
def test_wrong_arrays_are_refused(wrong: Any, message: str) -> None:
    with pytest.raises(plenocal.InputError, match=message):
        example("pinhole").project(wrong)


def test_wrong_cameras_are_refused() -> None:
    with pytest.raises(plenocal.InputError, match="unknown camera model 'pinhol'; did you mean 'pinhole'?"):
        plenocal.Camera("pinhol", (640, 480), [1, 1, 1, 1])
    with pytest.raises(plenocal.InputError, match="expected 4 values, found 3"):
        plenocal.Camera("pinhole", (640, 480), [1, 1, 1])
    with pytest.raises(plenocal.InputError, match="f_x must be above 0"):
        plenocal.Camera("pinhole", (640, 480), [-1, 1, 1, 1])
    with pytest.raises(plenocal.InputError, match="finite numbers"):
        plenocal.Camera("pinhole", (640, 480), [np.nan, 1, 1, 1])
    with pytest.raises(plenocal.InputError, match="image_size"):
        plenocal.Camera("pinhole", (640, 0), [1, 1, 1, 1])
    with pytest.raises(plenocal.InputError, match="rotation"):
        plenocal.Camera("pinhole", (640, 480), [1, 1, 1, 1], T_camera_rig=np.ones((4, 4)))
    with pytest.raises(plenocal.InputError, match="needs"):
        example("focused-plenoptic").project([[0.0, 0.0, 1.0]])


def test_maps_undistort() -> None:
    camera = example("pinhole-radtan")
    x, y, view = plenocal.undistort_maps(camera)
    width, height = camera.image_size
    assert x.shape == y.shape == (height, width)
    assert view.model == "pinhole"
    u, v = 100, 200
    source = camera.project(view.unproject([[float(u), float(v)]]))[0]
    np.testing.assert_allclose([x[v, u], y[v, u]], source, atol=1e-3)  # 32-bit


def test_maps_of_a_camera_without_a_centre_are_exact_at_a_distance() -> None:
    camera = plenocal.Camera(
        "equidistant+pupil", (640, 480), [210, 212, 322, 243, 0.004, 0, 0], name="axial"
    )
    x, y, view = plenocal.undistort_maps(camera, distance=0.5)
    u, v = 100, 200
    direction = view.unproject([[float(u), float(v)]])
    source = camera.project(0.5 * direction / np.linalg.norm(direction))[0]
    np.testing.assert_allclose([x[v, u], y[v, u]], source, atol=1e-3)  # 32-bit
    with pytest.raises(plenocal.InputError, match="give a distance"):
        plenocal.undistort_maps(camera)
    with pytest.raises(plenocal.InputError, match="distance: expected a number"):
        plenocal.undistort_maps(camera, distance=-1)


def test_maps_rectify() -> None:
    left = example("pinhole-radtan")
    pose = np.eye(4)
    pose[0, 3] = -0.1
    right = plenocal.Camera(
        left.model, left.image_size, left.params, name="right", T_camera_rig=pose
    )
    first, second, baseline = plenocal.rectify_maps(left, right)
    assert baseline == pytest.approx(0.1)
    p = np.array([[0.05, 0.02, 1.5]])
    rows = [
        m[2].project(p @ m[2].T_camera_rig[:3, :3].T + m[2].T_camera_rig[:3, 3])[0, 1]
        for m in (first, second)
    ]
    assert rows[0] == pytest.approx(rows[1], abs=1e-9)


def test_the_stub_names_what_the_extension_has() -> None:
    import plenocal._core as core

    stub = (pathlib.Path(plenocal.__file__).parent / "_core.pyi").read_text()
    for name, value in vars(core).items():
        if name.startswith("_"):
            continue
        assert re.search(rf"(def|class) {name}\b", stub), name
        for member in vars(value) if isinstance(value, type) else ():
            declared = rf"^    (def {member}\(|{member}: )"
            assert member.startswith("_") or re.search(declared, stub, re.MULTILINE), f"{name}.{member}"
