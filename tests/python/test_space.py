# SPDX-License-Identifier: Apache-2.0
"""Points in space from arrays: the numbers of `plenocal triangulate`, and the report's map of a camera's projection."""

from __future__ import annotations

import csv
import json
import pathlib
import re
from typing import Any

import numpy as np
import pytest

import plenocal

from conftest import ROOT

MARKERS = 36 * 4


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A calibrated rig of two ordinary cameras and a plenoptic one, in `result`; points of one new frame in `new`."""
    folder = tmp_path_factory.mktemp("space")
    (folder / "board.yaml").write_text(
        "plenocal: 1\ntype: aprilgrid\ncolumns: 6\nrows: 6\nsize: 0.055\nspacing: 0.3\n"
    )
    cameras = """
  left: {model: pinhole, image_size: [1280, 960], detection_sigma: 0.1,
    parameters: {f_x: 900, f_y: 901, c_x: 636, c_y: 483}}
  right: {model: pinhole, image_size: [1280, 960], detection_sigma: 0.1,
    parameters: {f_x: 905, f_y: 904, c_x: 641, c_y: 475}, xi_camera_rig: [-0.12, 0.001, 0.002, 0.01, -0.02, 0.01]}
  plenoptic: {model: focused-plenoptic, image_size: [800, 800], pixel_size: 7.4e-6, detection_sigma: 0.05,
    parameters: {f_L: 0.0122, b_L0: 0.01166, B: 0.00026, c_x: 402, c_y: 397, A_0: -210, A_1: 1.2e6, B_0: 0, B_1: 0},
    micro_lenses: {pitch: 19, rotation: 0.006, focus: [2.4, 3.0, 3.9]},
    xi_camera_rig: [-0.05, 0.001, 0.002, 0.01, -0.02, 0.01]}
"""
    for name, seed, frames in (("set", 1, 15), ("new", 2, 1)):
        (folder / f"{name}.yaml").write_text(
            f"plenocal: 1\nseed: {seed}\ntarget: board.yaml\n"
            f"poses: {{kind: varied, frames: {frames}, distance: [0.4, 0.7]}}\ncameras:{cameras}"
        )
        plenocal.simulate(folder / f"{name}.yaml", folder / name, points=True)
    plenocal.calibrate(folder / "set/session.yaml", folder / "result", report=False)
    return folder


def table(path: pathlib.Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def seen(place: pathlib.Path) -> dict[str, Any]:
    """Arguments of `triangulate` for the new frame."""
    pixels, context, index = {}, {}, {}
    for name in ("left", "right"):
        pixels[name] = np.full((MARKERS, 2), np.nan)
        for row in table(place / f"new/detections_{name}.csv"):
            pixels[name][int(row["marker"])] = float(row["x"]), float(row["y"])
    rows = table(place / "new/detections_plenoptic.csv")
    pixels["plenoptic"] = np.array([[float(row["x"]), float(row["y"])] for row in rows])
    context["plenoptic"] = np.array([[float(row["lens_x"]), float(row["lens_y"])] for row in rows])
    index["plenoptic"] = np.array([int(row["marker"]) for row in rows])
    return {"pixels": pixels, "context": context, "index": index, "sigma": 0.05}


@pytest.mark.parametrize("frame", ["rig", "housing"])
def test_points_and_measures_are_those_of_the_command(place: pathlib.Path, frame: str) -> None:
    tables = [f"{name}={place}/new/detections_{name}.csv" for name in ("left", "right", "plenoptic")]
    out = place / f"command_{frame}"
    options = ["--all-lengths", "--angle", "60,61,84", "--plane", "60,61,84,85", "--sigma", "0.05", "--frame", frame]
    plenocal.run(["triangulate", place / "result", *tables, *options, "-o", out])
    points = plenocal.triangulate(place / "result", **seen(place), frame=frame)
    rows = table(out / "points.csv")
    assert len(rows) == np.isfinite(points.positions).all(axis=1).sum() > 30
    for row in rows:
        i = int(row["marker"])
        np.testing.assert_allclose(points.positions[i], [float(row[c]) for c in "xyz"], rtol=1e-10)
        assert points.inverse_depth[i] == pytest.approx(float(row["rho"]), rel=1e-10)
        assert points.sigma_inverse_depth[i] == pytest.approx(float(row["sigma_rho"]), rel=1e-7)
        assert points.probability[i] == pytest.approx(float(row["probability"]), rel=1e-4)
        assert points.used[i] == (row["used"] == "1")
        assert points.covariance(i, i)[0, 2] == pytest.approx(float(row["cov_x_z"]), rel=1e-6)
        assert points.noise[i, 1, 1] == pytest.approx(float(row["noise_y_y"]), rel=1e-7)
    for row in table(out / "shared.csv"):
        root = points.shared[3 * int(row["marker"]) + "xyz".index(row["coordinate"])]
        np.testing.assert_allclose(root, [float(v) for k, v in row.items() if k[:2] == "c_"], rtol=1e-4, atol=1e-12)
    measures = table(out / "measures.csv")
    for row in [*measures[:50], *measures[-2:]]:
        of = [int(number) for number in row["of"].split()]
        if row["kind"] == "plane":
            plane = points.plane(of)
            assert plane.rms == pytest.approx(float(row["value"]), rel=1e-6)
            assert plane.chi_square == pytest.approx(float(row["chi_square"]), rel=1e-4)
            assert plane.degrees == int(row["degrees"])
            continue
        found = points.length(*of) if row["kind"] == "length" else points.angle(*of)
        names = {part: f"sigma_{part}" for part in ("calibration", "noise", "jitter")}
        for name, number in found._asdict().items():
            assert number == pytest.approx(float(row[names.get(name, name)]), rel=1e-6), name


def test_common_errors_are_in_the_covariance_of_two_points(place: pathlib.Path) -> None:
    points = plenocal.triangulate(plenocal.Calibration(place / "result"), **{**seen(place), "sigma": None})
    i, j = np.flatnonzero(points.used)[[0, 1]].tolist()
    u = (points.positions[i] - points.positions[j]) / points.length(i, j).value
    common = points.covariance(i, i) + points.covariance(j, j) - points.covariance(i, j) - points.covariance(j, i)
    assert points.length(i, j).sigma == pytest.approx(np.sqrt(u @ common @ u))
    chi_square, degrees, probability = points.rays
    assert degrees > 100 and 0.5 < chi_square / degrees < 1.5 and probability > 1e-4
    assert points.findings == []


def test_noise_of_each_row_and_the_adjusted_calibration(place: pathlib.Path) -> None:
    right = seen(place)
    one = plenocal.triangulate(place / "result", **right)
    rows = {name: np.full(len(pixels), 0.05) for name, pixels in right["pixels"].items()}
    np.testing.assert_array_equal(plenocal.triangulate(place / "result", **{**right, "sigma": rows}).noise, one.noise)
    assert one.adjusted == {}
    adjusted = plenocal.triangulate(place / "result", **right, adjust=True)
    parts = [number["sigma"] / number["sigma_before"] for number in adjusted.adjusted.values()]
    assert max(parts) < 1 + 1e-6 and min(parts) < 0.95
    i = int(np.flatnonzero(one.used)[0])
    assert np.trace(adjusted.covariance(i, i)) < np.trace(one.covariance(i, i))


def test_wrong_arguments_are_named(place: pathlib.Path) -> None:
    right = seen(place)
    calibration = plenocal.Calibration(place / "result")
    plain: dict[str, Any] = {"context": {}, "index": {}}
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"frame": "world"}, "frame: expected 'rig' or 'housing', found 'world'"),
        ({"sigma": 0.0}, "sigma: left: expected a positive number"),
        ({"pixels": {"front": [[1, 2]]}, **plain}, "pixels: no camera 'front'"),
        ({"pixels": {"left": [[1, 2, 3]]}, **plain}, r"pixels: left: expected an array of shape \(N, 2\)"),
        ({"pixels": {"left": right["pixels"]["left"]}, **plain}, "one ordinary camera sees directions"),
        ({"context": {}}, "needs lens_x, lens_y of each point"),
        ({"index": {"plenoptic": [0, 1]}}, "index: plenoptic: expected"),
        ({"index": {"left": np.zeros(MARKERS, int), **right["index"]}}, "a point is twice in one image"),
    ]
    for changed, message in wrong:
        with pytest.raises(plenocal.InputError, match=message):
            plenocal.triangulate(calibration, **{**right, **changed})
    with pytest.raises(plenocal.JobError, match="no point is seen by two rays"):
        plenocal.triangulate(calibration, {name: np.full((2, 2), np.nan) for name in ("left", "right")})
    points = plenocal.triangulate(calibration, **right)
    there = int(np.flatnonzero(points.used)[0])
    for other, message in [(there, "different points"), (len(points) + 3, f"there are {len(points)}")]:
        with pytest.raises(plenocal.InputError, match=message):
            points.length(there, other)


def test_the_map_of_the_projection_is_that_of_the_report(place: pathlib.Path) -> None:
    calibration = plenocal.Calibration(place / "result")
    calibration.report(place / "report.html")
    found = re.search(r'"projection":(\[.*?\]\}\])', (place / "report.html").read_text())
    assert found
    maps = json.loads(found[1])
    assert len(maps) == 4
    width, height = calibration["left"].image_size
    for drawn in maps:
        x, y = np.meshgrid(
            (np.arange(drawn["columns"]) + 0.5) * width / drawn["columns"] - 0.5,
            (np.arange(drawn["rows"]) + 0.5) * height / drawn["rows"] - 0.5,
        )
        sigma = calibration.projection_sigma(np.column_stack([x.ravel(), y.ravel()]), drawn["distance"], "left")
        np.testing.assert_allclose(sigma, np.array(drawn["sigma"], float), rtol=6e-3)
    with pytest.raises(plenocal.InputError, match="distance: expected a positive number"):
        calibration.projection_sigma([[1, 2]], 0)
    with pytest.raises(plenocal.InputError, match="no standard errors"):
        plenocal.Calibration.of_cameras(calibration.cameras[:1]).projection_sigma([[1, 2]], 1)
    assert len(plenocal.Calibration.of_cameras(calibration.cameras).residuals()) == 0
