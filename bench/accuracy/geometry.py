# SPDX-License-Identifier: Apache-2.0
"""Rotations, rigid transforms and files of poses in numpy, without the program (docs/conventions.md)."""
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common


def numbers(values):
    """Of a list in a YAML file: PyYAML reads 5e-05 as text."""
    return np.array([float(v) for v in values])


def exp_rotation(w):
    angle = np.linalg.norm(w)
    K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    if angle < 1e-12:
        return np.eye(3) + K
    return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * K @ K


def log_rotation(R):
    x, y, z, w = quaternion(R)
    v = np.array([x, y, z]) * (1 if w >= 0 else -1)
    n = np.linalg.norm(v)
    return v * (2 * np.arctan2(n, abs(w)) / n if n > 1e-12 else 2)


def translation_matrix(w):
    """V of exp(xi): t = V v."""
    angle = np.linalg.norm(w)
    K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return np.eye(3) + (1 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * K @ K


def transform(R, t):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def exponential(xi):
    return transform(exp_rotation(xi[3:]), translation_matrix(xi[3:]) @ xi[:3])


def difference(xi, truth):
    """xi - truth; of a rotation by nearly pi the se(3) vector of the truth that is nearer."""
    v, w = truth[:3], truth[3:]
    if np.linalg.norm(xi[3:] - w) > np.pi:
        t = translation_matrix(w) @ v
        w = w * (1 - 2 * np.pi / np.linalg.norm(w))
        v = np.linalg.solve(translation_matrix(w), t)
    return xi - np.concatenate([v, w])


def quaternion(R):
    w = np.sqrt(max(0.0, 1 + np.trace(R))) / 2
    if w > 1e-6:
        v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * w)
        return [*v, w]
    values, vectors = np.linalg.eigh((R + R.T) / 2)
    return [*vectors[:, np.argmax(values)], 0.0]


def rotation_of(x, y, z, w):
    """Of a quaternion, or of many (arrays of equal length; the last axis counts them)."""
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def plenoptic_distortion(at, p):
    """Displacement of undistorted raw image points, m about the principal point (docs/plenoptic.md)."""
    x, y = at.T
    r2 = x * x + y * y
    radial = p["A_0"] * r2 + p["A_1"] * r2**2
    return np.stack([x * radial + p["B_0"] * (r2 + 2 * x * x) + 2 * p["B_1"] * x * y,
                     y * radial + p["B_1"] * (r2 + 2 * y * y) + 2 * p["B_0"] * x * y], 1)


def plenoptic_undistorted(distorted, p):
    at = distorted
    for _ in range(20):
        at = distorted - plenoptic_distortion(at, p)
    return at


def read_poses(path):
    """Transforms by the name of the frame, of poses.csv."""
    poses = {}
    for row in common.read_table(path):
        x, y, z, *q = (float(row[key]) for key in ("x", "y", "z", "qx", "qy", "qz", "qw"))
        poses[row["frame"]] = transform(rotation_of(*q), [x, y, z])
    return poses


def read_trajectory(path):
    """Times, positions, rotations R_world_camera of a trajectory in TUM form."""
    rows = np.loadtxt(path, ndmin=2)
    return rows[:, 0], rows[:, 1:4], np.moveaxis(rotation_of(*rows[:, 4:].T), 2, 0)
