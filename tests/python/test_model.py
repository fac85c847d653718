# SPDX-License-Identifier: Apache-2.0
"""Camera models written in Python, in the same adjustment as the C++ ones."""

from __future__ import annotations

import math
import os
import pathlib
import threading
import time
from typing import Any, ClassVar, Sequence

import numpy as np
import pytest

import plenocal

PLUGIN = os.environ.get("PLENOCAL_TEST_PLUGIN", "")

SPECIFICATION = """\
plenocal: 1
seed: 5
target: board.yaml
poses: {{kind: varied, frames: 5, distance: [0.4, 1.0]}}
cameras:
  cam:
    model: {model}
    image_size: [640, 480]
    parameters: {{f_x: 410, f_y: 405, c_x: 322, c_y: 243, k_1: -0.01, k_2: 0.002}}
    detection_sigma: 0.1
"""


class Stereographic(plenocal.CameraModel):
    """The model of docs/new_model.md."""

    name = "py-stereographic"
    source = "docs/new_model.md"
    params = (
        *plenocal.INTRINSICS,
        plenocal.Param("k_1", scale=1, neutral=0),
        plenocal.Param("k_2", scale=1, neutral=0),
    )
    example: ClassVar[Sequence[float]] = (410, 405, 322, 243, -0.01, 0.002)

    def project(self, params: Sequence[Any], point: Sequence[Any]) -> tuple[Any, Any]:
        f_x, f_y, c_x, c_y, k_1, k_2 = params
        x, y, z = point
        d = np.sqrt(x * x + y * y + z * z)
        x, y = 2 * x / (d + z), 2 * y / (d + z)
        s = x * x + y * y
        g = 1 + k_1 * s + k_2 * s * s
        inside = (1 + 3 * k_1 * s + 5 * k_2 * s * s > 0) & (s < 36)
        return np.where(inside, f_x * g * x + c_x, np.nan), f_y * g * y + c_y


class WithJacobian(Stereographic):
    name = "py-stereographic-jacobian"
    calls = 0

    def jacobian(self, params: Sequence[float], point: Sequence[float]) -> tuple[Any, Any, Any]:
        WithJacobian.calls += 1
        values = [np.array([v], dtype=complex) for v in (*params, *point)]
        step = 1e-150  # the imaginary part is the derivative (Squire and Trapp 1998)

        def at(changed: list[Any]) -> Any:
            return np.concatenate(self.project(changed[:6], changed[6:]))

        slopes = []
        for i in range(9):
            moved = list(values)
            moved[i] = values[i] + 1j * step
            slopes.append(at(moved).imag / step)
        J = np.array(slopes).T
        return at(values).real, J[:, :6], J[:, 6:]


class WithArrays(Stereographic):
    name = "py-stereographic-arrays"
    calls = 0

    def jacobian(self, params: Sequence[float], point: Sequence[Any]) -> tuple[Any, Any, Any]:
        WithArrays.calls += 1
        values = np.array([*(np.full(len(point[0]), v) for v in params), *point], dtype=complex)
        step = 1e-150
        slopes = []
        for i in range(9):
            moved = values.copy()
            moved[i] += 1j * step
            slopes.append(np.stack(self.project(list(moved[:6]), list(moved[6:])), 1).imag / step)
        J = np.stack(slopes, 2)
        return np.stack(self.project(list(values[:6]), list(values[6:])), 1).real, J[:, :, :6], J[:, :, 6:]


plenocal.register(Stereographic)
plenocal.register(WithJacobian)
plenocal.register(WithArrays)


def simulate(folder: pathlib.Path, model: str) -> plenocal.Session:
    folder.mkdir()
    target = plenocal.Target("chessboard:7x5:50mm")
    (folder / "board.yaml").write_text(target.yaml)
    (folder / "spec.yaml").write_text(SPECIFICATION.format(model=model))
    return plenocal.simulate(folder / "spec.yaml", folder / "set", points=True)


@pytest.mark.parametrize("model", [Stereographic, WithJacobian, WithArrays])
def test_passes_the_checks_of_the_models(model: type[plenocal.CameraModel]) -> None:
    text = plenocal.check_model(model.name)
    assert text.count("holds") == 11


def test_projects_inverts_and_differentiates() -> None:
    camera = plenocal.Camera(Stereographic.name, (640, 480), Stereographic.example)
    points = np.random.default_rng(1).normal(size=(50, 3)) * [1, 1, 0.5] + [0, 0, 1]
    pixels = camera.project(points)
    inside = np.isfinite(pixels).all(axis=1)
    assert inside.sum() > 40
    directions = points[inside] / np.linalg.norm(points[inside], axis=1, keepdims=True)
    np.testing.assert_allclose(camera.unproject(pixels[inside]), directions, atol=1e-8)
    a = camera.jacobian(points[inside])
    for model, calls in ((WithJacobian, inside.sum()), (WithArrays, 1)):
        before = model.calls
        b = plenocal.Camera(model.name, (640, 480), model.example).jacobian(points[inside])
        assert model.calls == before + calls
        np.testing.assert_allclose(a.by_params, b.by_params, rtol=1e-7, atol=1e-6)
        np.testing.assert_allclose(a.by_point, b.by_point, rtol=1e-7, atol=1e-6)


class Counting(Stereographic):
    name = "py-counting"
    calls = 0

    def project(self, params: Sequence[Any], point: Sequence[Any]) -> tuple[Any, Any]:
        Counting.calls += 1
        return super().project(params, point)


plenocal.register(Counting)


def test_projects_arrays_in_blocks() -> None:
    camera = plenocal.Camera("py-counting", (640, 480), Counting.example)
    points = np.random.default_rng(4).normal(size=(600, 3))
    before = Counting.calls
    pixels, by_params, by_point = camera.jacobian(points)
    assert Counting.calls - before == 3  # 256 points each
    np.testing.assert_array_equal(camera.project(points), pixels)
    assert np.isnan(pixels).any() and np.isfinite(pixels).any()
    for i in range(0, len(points), 60):
        one = camera.jacobian(points[i : i + 1])
        np.testing.assert_allclose(pixels[i], one[0][0], rtol=1e-12)
        np.testing.assert_allclose(by_params[i], one[1][0], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(by_point[i], one[2][0], rtol=1e-6, atol=1e-5)


def test_calibrates(tmp_path: pathlib.Path) -> None:
    session = simulate(tmp_path / "cam", Stereographic.name)
    result = plenocal.calibrate(session, report=False)
    camera = result[0]
    assert camera.model == Stereographic.name
    error = (camera.params - np.array(Stereographic.example)) / np.sqrt(np.diag(camera.covariance))
    assert np.abs(error).max() < 4
    assert camera.fit["rms"] < 0.2


def test_an_exception_in_project_is_raised(tmp_path: pathlib.Path) -> None:
    class Broken(Stereographic):
        name = "py-broken"

        def project(self, params: Sequence[Any], point: Sequence[Any]) -> tuple[Any, Any]:
            raise ZeroDivisionError("in the model")

    plenocal.register(Broken)
    camera = plenocal.Camera("py-broken", (640, 480), Broken.example)
    with pytest.raises(ZeroDivisionError, match="in the model"):
        camera.project([[0.0, 0.0, 1.0]])
    session = simulate(tmp_path / "cam", Stereographic.name)
    text = pathlib.Path(session.path).read_text().replace(Stereographic.name, "py-broken")
    pathlib.Path(session.path).write_text(text)
    with pytest.raises(ZeroDivisionError, match="in the model"):
        plenocal.calibrate(session, report=False)


class BreaksLate(Stereographic):
    """Raises after `limit` calls: with some hundred, while the parameters are adjusted.

    Other tests' calibrations may try it as an alternative to their models, so it has no limit outside of its test.
    """

    name = "py-breaks-late"
    calls = 0
    limit = math.inf

    def project(self, params: Sequence[Any], point: Sequence[Any]) -> tuple[Any, Any]:
        BreaksLate.calls += 1
        if BreaksLate.calls > BreaksLate.limit:
            raise ZeroDivisionError("in the model")
        return super().project(params, point)


plenocal.register(BreaksLate)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_exception_in_project_ends_its_own_run_alone(tmp_path: pathlib.Path, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    good = simulate(tmp_path / "good", Stereographic.name)
    broken = pathlib.Path(simulate(tmp_path / "broken", Stereographic.name).path)
    broken.write_text(broken.read_text().replace(Stereographic.name, BreaksLate.name))
    alone = plenocal.calibrate(good, threads=threads)
    monkeypatch.setattr(BreaksLate, "calls", 0)
    monkeypatch.setattr(BreaksLate, "limit", 300)
    results: dict[str, Any] = {}

    def work(name: str, session: Any) -> None:
        try:
            results[name] = plenocal.calibrate(session, threads=threads)
        except ZeroDivisionError as error:
            results[name] = error

    def fail_beside_runs() -> None:
        camera = plenocal.Camera(BreaksLate.name, (640, 480), Stereographic.example)
        while running:
            if BreaksLate.calls > BreaksLate.limit:
                with pytest.raises(ZeroDivisionError):
                    camera.project([[0.0, 0.0, 1.0]])
            time.sleep(0.001)

    running = True
    beside = threading.Thread(target=fail_beside_runs)
    runs = [threading.Thread(target=work, args=run) for run in (("good", good), ("broken", broken))]
    for thread in (beside, *runs):
        thread.start()
    for thread in runs:
        thread.join()
    running = False
    beside.join()
    assert str(results["broken"]) == "in the model"
    np.testing.assert_array_equal(results["good"][0].params, alone[0].params)


@pytest.mark.skipif(not PLUGIN, reason="PLENOCAL_TEST_PLUGIN names no plug-in")
def test_a_plug_in_is_the_same_model(tmp_path: pathlib.Path) -> None:
    plenocal.load_plugin(PLUGIN)
    plenocal.load_plugin(PLUGIN)  # once, however often it is named
    assert "stereographic" in plenocal.models()
    info = plenocal.model_info("stereographic")
    plugin = plenocal.Camera("stereographic", info["example_size"], Stereographic.example)
    python = plenocal.Camera(Stereographic.name, info["example_size"], Stereographic.example)
    points = np.random.default_rng(2).normal(size=(50, 3)) * [1, 1, 0.3] + [0, 0, 1]
    a, b = plugin.project(points), python.project(points)
    both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    assert both.sum() > 30
    np.testing.assert_allclose(a[both], b[both], rtol=0, atol=1e-9)
    (tmp_path / "libnone.so").write_text("no library")
    with pytest.raises(plenocal.InputError, match="libnone.so: is no shared library"):
        plenocal.load_plugin(tmp_path / "libnone.so")


def test_wrong_models_are_refused() -> None:
    class Twice(Stereographic):
        pass

    with pytest.raises(plenocal.InputError, match="there is a camera model 'py-stereographic' already"):
        plenocal.register(Twice)

    class Odd(Stereographic):
        name = "Odd Name"

    with pytest.raises(plenocal.InputError, match="name: expected letters"):
        plenocal.register(Odd)

    class Short(Stereographic):
        name = "py-short"
        example = (1, 2)

    with pytest.raises(plenocal.InputError, match="expected 6 values, found 2"):
        plenocal.register(Short)
