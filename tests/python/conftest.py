# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pathlib

import numpy as np
import pytest
from hypothesis.configuration import set_hypothesis_home_dir

import plenocal

ROOT = pathlib.Path(__file__).resolve().parents[2]
set_hypothesis_home_dir(ROOT / "build/hypothesis")
CHESSBOARDS = ROOT / "tests/data/frames/stereo_chess_opencv"

@pytest.fixture(autouse=True)
def names_of_doctests(doctest_namespace: dict[str, object], tmp_path: pathlib.Path) -> None:
    doctest_namespace["np"] = np
    doctest_namespace["plenocal"] = plenocal
    doctest_namespace["CHESSBOARDS"] = CHESSBOARDS
    doctest_namespace["folder"] = tmp_path


@pytest.fixture(scope="session")
def session(tmp_path_factory: pytest.TempPathFactory) -> plenocal.Session:
    """Points of one simulated camera."""
    folder = tmp_path_factory.mktemp("simulated")
    examples = ROOT / "examples/simulate"
    text = (examples / "one_camera.yaml").read_text()
    (folder / "spec.yaml").write_text(text.replace("frames: 30", "frames: 12"))
    (folder / "board.yaml").write_text((examples / "board.yaml").read_text())
    return plenocal.simulate(folder / "spec.yaml", folder / "set", points=True)


@pytest.fixture(scope="session")
def calibration(
    session: plenocal.Session, tmp_path_factory: pytest.TempPathFactory
) -> plenocal.Calibration:
    return plenocal.calibrate(session, tmp_path_factory.mktemp("calibrated"))
