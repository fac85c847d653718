# SPDX-License-Identifier: Apache-2.0
"""Whatever comes in, numbers or an exception of plenocal come out."""

from __future__ import annotations

import pathlib
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import plenocal

from test_camera import context_of, example

CAMERAS = [example(model) for model in plenocal.models() if not model.startswith("py-")]

anything = st.one_of(
    hnp.arrays(
        dtype=st.sampled_from(["f8", "f4", "i4", "u1", "?", "c16", "U3", "O", "M8[s]"]),
        shape=hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    ),
    st.none(),
    st.text(max_size=5),
    st.lists(st.lists(st.floats(), max_size=4), max_size=4),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=2),
)
rows = hnp.arrays("f8", st.tuples(st.integers(0, 5), st.just(3)), elements=st.floats(width=64))
fuzz = settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


@fuzz
@given(anything, anything, st.sampled_from(CAMERAS))
def test_arguments_of_any_kind(value: Any, other: Any, camera: plenocal.Camera) -> None:
    for call in (
        lambda: camera.project(value, other),
        lambda: camera.rays(value, other),
        lambda: camera.jacobian(value, other),
        lambda: camera.uncertainty(value, other),
        lambda: plenocal.Camera(camera.model, (640, 480), value),
        lambda: plenocal.Camera("pinhole", (640, 480), [1, 1, 1, 1], T_camera_rig=value),
        lambda: plenocal.Camera("pinhole", (640, 480), [1, 1, 1, 1], covariance=value),
        lambda: plenocal.detect(value, "chessboard:3x3:10mm"),
    ):
        try:
            call()
        except (plenocal.Error, TypeError):
            pass


@fuzz
@given(rows, st.sampled_from(CAMERAS))
def test_points_anywhere(points: Any, camera: plenocal.Camera) -> None:
    context = context_of(camera, len(points))
    pixels = camera.project(points, context)
    outside = np.isnan(pixels)
    # A point is imaged or not; nothing is infinite.
    assert (outside.all(axis=1) == outside.any(axis=1)).all()
    assert not np.isinf(pixels).any()
    directions = camera.rays(pixels, context).directions
    assert np.isnan(directions[outside.any(axis=1)]).all()
    assert camera.jacobian(points, context).by_params.shape[0] == len(points)


@fuzz
@given(st.lists(st.text(st.characters(exclude_categories=["Cs"]), max_size=8), max_size=4))
def test_command_lines(words: list[str]) -> None:
    # Names of commands would have them write files.
    try:
        plenocal.run(["models", *words])
    except plenocal.Error as error:
        assert str(error)


@fuzz
@given(st.binary(max_size=200))
def test_files(tmp_path: pathlib.Path, content: bytes) -> None:
    file = tmp_path / "file.yaml"
    file.write_bytes(content)
    for call in (plenocal.Session, plenocal.Calibration, plenocal.Target):
        try:
            call(file)
        except plenocal.Error as error:
            assert "file.yaml" in str(error)
    try:
        plenocal.detect(file, "chessboard:3x3:10mm")
    except plenocal.Error as error:
        assert "file.yaml" in str(error)
