#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Plenoptic detections behind a real main lens: rays traced through a published design.

    bench/lens_trace DESIGN.csv OUT [--focal 16] [--seed 0] [--frames 12] [--noise 0.02] [--model plenoptic-thick]
    bench/lens_trace FOLDER OUT --check PLENOCAL [--sets 40]     # random designs of a folder, focal lengths of 12 to 50 mm

DESIGN: radius;thickness;material;index;v-no;sa as in $PLENOCAL_DATA/plenoptic_real/lens_prescriptions/csv (the row without radius in
air is the stop), scaled to --focal mm. Behind it stands an R5-like array, regular at the micro lenses; micro lenses are pinholes.
lens_x, lens_y: the chief ray through the middle of the stop and of the micro lens; x, y: the ray from the point through the same
pinhole, within 0.35 pitches. Writes session.yaml, target.yaml, detections.csv, poses.csv and truth.yaml (paraxial values). No line of
it is a formula of models/start/plenoptic_model.h. --check calibrates, and prints the mean of (error / sigma)^2 of lengths in space:
from a corner of the target in one frame to the opposite one in the next. Needs python3-numpy, python3-yaml.
"""
import csv
import pathlib
import re
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import exp_rotation, plenoptic_distortion, plenoptic_undistorted, quaternion, read_poses

PIXEL, PITCH, SIZE, B = 5.5e-6, 23.2, 1712, 0.343e-3
AT_INFINITY, NEAREST, FARTHEST = 2.0, 5.0, 2.95  # virtual depths (v_P)


class Lens:
    """Spherical surfaces (z, curvature, index before, index behind, semi-aperture), m; light runs along z."""

    def __init__(self, path, focal):
        rows = list(csv.DictReader(open(path), delimiter=";"))
        z, index, self.surfaces, self.stop = 0.0, 1.0, [], None
        for row in rows:
            behind = float(row["index"] or 1)
            if not row["radius"] and row["material"] == "air" and index == 1:
                self.stop = len(self.surfaces)
            self.surfaces.append([z, 1 / float(row["radius"]) if row["radius"] else 0.0, index, behind, float(row["sa"])])
            z, index = z + float(row["thickness"]), behind
        if self.stop is None:
            raise common.Failed(f"{path}: no stop")
        scale = focal / self.paraxial()[0]
        self.surfaces = [[z * scale, curvature / scale, n, m, sa * scale] for z, curvature, n, m, sa in self.surfaces]

    def trace(self, p, d, surfaces):
        """Rays p + t d behind these surfaces (against the light in descending order), and which of them pass."""
        passed = np.ones(len(p), bool)
        for k in surfaces:
            z, curvature, before, behind, aperture = self.surfaces[k]
            d = d / np.linalg.norm(d, axis=1, keepdims=True)
            onward = np.sign(d[:, 2])
            p = p + d * ((z - p[:, 2]) / d[:, 2])[:, None]  # to the plane, from there to the sphere
            b = d[:, 2] - curvature * (p * d)[:, :2].sum(1)
            root = b**2 - curvature**2 * (p[:, :2]**2).sum(1)
            passed &= root >= 0
            t = curvature * (p[:, :2]**2).sum(1) / (b + onward * np.sqrt(np.maximum(root, 0)))
            p = p + d * t[:, None]
            passed &= np.hypot(p[:, 0], p[:, 1]) <= aperture
            normal = np.column_stack([-curvature * p[:, :2], 1 - curvature * (p[:, 2] - z)]) * onward[:, None]  # along the ray
            ratio = before / behind if onward[0] > 0 else behind / before
            cosine = (normal * d).sum(1)
            inside = 1 - ratio**2 * (1 - cosine**2)
            passed &= inside >= 0
            d = ratio * d + (np.sqrt(np.maximum(inside, 0)) - ratio * cosine)[:, None] * normal
        return p, d, passed

    def on_axis(self, z, slope, surfaces):
        """Height and slope beyond the surfaces of a ray near the axis, and where it meets the axis."""
        h = 1e-7
        onward = 1 if surfaces[-1] >= surfaces[0] else -1
        p, d, _ = self.trace(np.array([[h * (slope == 0), 0, z]]), np.array([[h * slope, 0, onward]]), surfaces)
        slope_behind = d[0, 0] / d[0, 2]
        return p[0, 2] - p[0, 0] / slope_behind, -h / slope_behind

    def paraxial(self):
        """Focal length; z of rear focus, exit pupil, front focus, entrance pupil."""
        every, stop = list(range(len(self.surfaces))), self.surfaces[self.stop][0]
        focus, focal = self.on_axis(-1.0, 0, every)
        front, _ = self.on_axis(1.0 + self.surfaces[-1][0], 0, every[::-1])
        exit_pupil, _ = self.on_axis(stop, 1, every[self.stop:])
        entrance_pupil, _ = self.on_axis(stop, 1, every[self.stop::-1])
        return focal, focus, exit_pupil, front, entrance_pupil

    def aim(self, p, slope, onward, surfaces, miss):
        """Slopes by z with which rays from p have no `miss` (their points and directions beyond the surfaces) any more."""
        for _ in range(5):
            at = []
            for step in ((0, 0), (1e-6, 0), (0, 1e-6)):
                q, d, passed = self.trace(p, onward * np.column_stack([slope + step, np.ones(len(p))]), surfaces)
                at.append(miss(q, d / d[:, 2:]))
            J = np.stack([(at[1] - at[0]) / 1e-6, (at[2] - at[0]) / 1e-6], -1)
            slope = slope - np.linalg.solve(J, at[0][..., None])[..., 0]
        return slope, passed & (np.abs(at[0]).max(1) < 1e-9)


class Camera:
    """The lens with its array. Raw images are upright: their x runs with that of the image behind the lens, their y against it."""

    def __init__(self, lens):
        self.lens = lens
        f, focus, exit_pupil, front, entrance_pupil = lens.paraxial()
        self.f, self.b_L0, self.front = f, f - AT_INFINITY * B, front + f
        self.array = focus - AT_INFINITY * B
        self.truth = dict(f_L=f, b_L0=self.b_L0, B=B, b_P=self.array - exit_pupil, c_x=(SIZE - 1) / 2, c_y=(SIZE - 1) / 2,
                          entrance_pupil=self.front - entrance_pupil)
        reach = int(0.62 * SIZE / PITCH) + 2
        i, j = np.mgrid[-reach:reach + 1, -2 * reach:2 * reach + 1].reshape(2, -1)
        lenses = PITCH * PIXEL * self.b_L0 / (self.b_L0 + B) * np.column_stack([i + j / 2, j * np.sqrt(3) / 2])
        lenses = lenses[np.abs(lenses).max(1) < (SIZE / 2 + PITCH) * PIXEL]
        self.lenses = np.column_stack([lenses, np.full(len(lenses), self.array)])
        # From the middle of the stop on.
        slope, passed = lens.aim(self.lenses, lenses / (self.array - exit_pupil), -1, range(len(lens.surfaces) - 1, lens.stop - 1, -1),
                                 lambda p, d: p[:, :2])
        self.lenses, self.centres = self.lenses[passed], (lenses + B * slope)[passed]

    def pixels(self, x):
        return (SIZE - 1) / 2 + x * [1, -1] / PIXEL

    def observe(self, points):
        """Numbers of the points (camera's frame, whose origin is the front principal point), images and micro-image centres, px."""
        lens, pairs = self.lens, []
        p = points + [0, 0, self.front]
        p[:, 2] = self.front - points[:, 2]
        entrance = self.front - self.truth["entrance_pupil"]
        p[:, 0] *= -1  # x to the left along the light, y stays: a turn about the vertical axis
        slope, seen = lens.aim(p, -p[:, :2] / (entrance - p[:, 2])[:, None], 1, range(lens.stop + 1), lambda q, d: q[:, :2])
        q, d, passed = lens.trace(p, np.column_stack([slope, np.ones(len(p))]), range(len(lens.surfaces)))
        q = q + d * ((self.array - q[:, 2]) / d[:, 2])[:, None]
        depth = (1 / (1 / self.f - 1 / points[:, 2]) - self.b_L0) / B
        for k in np.flatnonzero(seen & passed):
            near = np.hypot(*(self.lenses[:, :2] - q[k, :2]).T) < PITCH * PIXEL * (0.39 * abs(depth[k]) + 0.2)
            pairs += [(k, i) for i in np.flatnonzero(near)]
        point, at = np.array(pairs).T
        here = self.lenses[at]
        start = (q[point, :2] - here[:, :2]) / (depth[point] * B)[:, None] + (self.centres - self.lenses[:, :2])[at] / B
        found, passed = lens.aim(here, start, -1, range(len(lens.surfaces) - 1, -1, -1),
                                 lambda o, d: o[:, :2] + d[:, :2] * (p[point, 2:] - o[:, 2:]) - p[point, :2])
        x, c = self.pixels(here[:, :2] + B * found), self.pixels(self.centres[at])
        keep = passed & (np.hypot(*(x - c).T) < 0.35 * PITCH) & (np.abs(np.hstack([x, c]) - (SIZE - 1) / 2) < SIZE / 2 - 1).all(1)
        return point[keep], x[keep], c[keep]


def write_set(path, out, focal, seed, frames, noise, model):
    random = np.random.default_rng(seed)
    camera = Camera(Lens(path, focal))
    f = camera.f
    near, far = [f + f**2 / ((v - AT_INFINITY) * B) for v in (NEAREST, FARTHEST)]
    field = SIZE * PIXEL / camera.b_L0
    spacing = 0.75 * np.sqrt(near * far) * field / 10
    grid = np.mgrid[-5:6, -5:6].reshape(2, -1)[::-1].T * spacing
    target = np.column_stack([grid, np.zeros(len(grid))])
    detections, poses = ["frame,marker,x,y,lens_x,lens_y,sigma"], ["frame,x,y,z,qx,qy,qz,qw"]
    for frame in range(frames):
        z = np.exp(random.uniform(np.log(near * 1.15), np.log(far * 0.9)))
        tilt, around = random.uniform(0.25, 0.65), random.uniform(0, 2 * np.pi)
        R = exp_rotation([tilt * np.cos(around), tilt * np.sin(around), 0]) @ exp_rotation([0, 0, random.uniform(-0.8, 0.8)])
        t = np.array([*(0.25 * field * z * random.uniform(-1, 1, 2)), z])
        for k, x, c in zip(*camera.observe(target @ R.T + t)):
            values = [*(x + noise * random.normal(size=2)), *c]
            detections.append(f"{frame:02},{k}," + ",".join(f"{v:.5f}" for v in values) + f",{max(noise, 0.001)}")
        poses.append(f"{frame:02}," + ",".join(f"{v:.9f}" for v in [*(-R.T @ t), *quaternion(R.T)]))
    out.mkdir(parents=True, exist_ok=True)
    (out / "detections.csv").write_text("\n".join(detections) + "\n")
    (out / "poses.csv").write_text("\n".join(poses) + "\n")
    common.save(out / "truth.yaml", {key: float(value) for key, value in camera.truth.items()})
    common.save(out / "target.yaml", dict(type="markers", tolerance=1e-7, markers={k: [float(v) for v in x] for k, x in enumerate(target)}))
    common.save(out / "session.yaml", dict(target="target.yaml", options=dict(refine_target=False), cameras=dict(plenoptic=dict(
        model=model, image_size=[SIZE, SIZE], pixel_size=PIXEL, detections="detections.csv"))))
    return camera


def project(p, X, lens):
    """Image, px, of points X in the camera's frame through micro lenses (docs/plenoptic.md)."""
    middle = np.array([p["c_x"], p["c_y"]])
    c = plenoptic_undistorted((lens - middle) * PIXEL, p)
    beyond = X[:, 2] - p["f_L"]
    d = p["f_L"] * X[:, 2] - p["b_L0"] * beyond
    m = (1 - p["B"] * beyond / d) / (1 + p["B"] / p["b_L0"])
    thin = X[:, :2] * (p["f_L"] * p["B"] / d)[:, None] + c * m[:, None]
    d = thin - c
    dd, cd, cc = [(a * b).sum(1)[:, None] for a, b in ((d, d), (c, d), (c, c))]
    thin = thin + sum(p.get(f"T_{k + 1}", 0) * term for k, term in enumerate((dd * d, 2 * cd * d + dd * c, cd * c, cc * d)))
    return (thin + plenoptic_distortion(thin, p)) / PIXEL + middle


def length_errors(folder, result):
    """(error, sigma) of the lengths, m, by the calibration in `folder`."""
    camera = result["cameras"]["plenoptic"]
    p, sigma, noise = camera["parameters"], camera["sigma"], camera["residuals"]["noise"]
    free = [key for key in p if sigma[key] > 0]
    table = {row["unknown"]: row for row in common.read_table(folder / "result/correlations.csv")}
    names = [f"plenoptic.{key}" for key in free]
    scale = np.array([sigma[key] for key in free])
    C = np.array([[float(table[a][b]) for b in names] for a in names]) * np.outer(scale, scale)
    target = {int(k): np.array(x) for k, x in common.load(folder / "target.yaml")["markers"].items()}
    rows = common.read_table(folder / "detections.csv")
    truth, found = read_poses(folder / "poses.csv"), read_poses(folder / "result/poses.csv")
    ends = []  # by frame: the points, their derivatives by the camera, and the covariance by the frame's own noise
    for frame in sorted(found):
        in_frame = [row for row in rows if row["frame"] == frame]
        lens = np.array([[float(row["lens_x"]), float(row["lens_y"])] for row in in_frame])
        T = np.linalg.inv(found[frame])
        local = np.array([target[int(row["marker"])] for row in in_frame])
        X = local @ T[:3, :3].T + T[:3, 3]

        def by(image, step):
            return (image(step) - image(-step)).ravel() / (2 * step)
        J = np.column_stack([by(lambda h, key=key: project({**p, key: p[key] + h}, X, lens), 0.1 * sigma[key]) for key in free])
        J_pose = np.column_stack([by(lambda h, d=d: project(p, X + h * d, lens), 1e-6)
                                  for d in [*np.eye(3)[:, None, :], *(np.cross(e, X) for e in np.eye(3))]])
        inverse = np.linalg.inv(J_pose.T @ J_pose)
        corner = np.array([target[min(target)], target[max(target)]])
        at = corner @ T[:3, :3].T + T[:3, 3]
        true = corner @ np.linalg.inv(truth[frame])[:3, :3].T + np.linalg.inv(truth[frame])[:3, 3]
        by_pose = [np.column_stack([*np.eye(3), *np.cross(np.eye(3), x)]) for x in at]
        ends.append((at, true, [-b @ inverse @ J_pose.T @ J for b in by_pose], [noise**2 * b @ inverse @ b.T for b in by_pose]))
    for (a, true_a, by_a, own_a), (b, true_b, by_b, own_b) in zip(ends[::2], ends[1::2]):
        along = a[0] - b[1]
        length = np.linalg.norm(along)
        along = along / length
        row = along @ (by_a[0] - by_b[1])
        variance = row @ C @ row + along @ (own_a[0] + own_b[1]) @ along
        yield length - np.linalg.norm(true_a[0] - true_b[1]), np.sqrt(variance)


def check(program, designs, out, sets, noise, model):
    """Prints the lengths' mean squares, camera by camera and of all."""
    squares, sizes = [], []
    for seed in range(sets):
        random = np.random.default_rng([seed, 7])
        path, focal = designs[random.integers(len(designs))], np.exp(random.uniform(np.log(12e-3), np.log(50e-3)))
        folder = out / f"{seed:02}"
        write_set(path, folder, focal, seed, 12, noise, model)
        result = common.calibrate(program, folder / "session.yaml", folder / "result")
        errors = np.array(list(length_errors(folder, result)))
        squares.append(np.mean((errors[:, 0] / errors[:, 1])**2))
        sizes += list(errors[:, 1])
        fit = result["cameras"]["plenoptic"]["residuals"]
        print(f"{seed:3}  {1e3 * focal:5.1f} mm  RMS {fit['rms'] / 2**0.5:.4f} px  (error / sigma)^2 {squares[-1]:5.2f}"
              f"  sigma {1e3 * np.median(errors[:, 1]):.4f} mm  {path.stem}", flush=True)
    print(f"mean of all {np.mean(squares):.2f} +- {np.std(squares) / len(squares)**0.5:.2f}; median sigma {1e3 * np.median(sizes):.4f} mm")


def main():
    parser = common.parser(__doc__, None)
    parser.add_argument("design", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--focal", type=float, default=16, help="mm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--noise", type=float, default=0.02, help="px")
    parser.add_argument("--model", default="plenoptic-thick")
    parser.add_argument("--check", type=common.program)
    parser.add_argument("--sets", type=int, default=40)
    arguments = parser.parse_args()
    if arguments.check:
        # Fast normal lenses.
        named = [(re.search(r"^D-Gauss.* F([\d.]+) ([\d.]+)deg", path.name), path) for path in sorted(arguments.design.iterdir())]
        designs = [path for match, path in named if match and float(match[1]) < 3 and float(match[2]) > 25]
        return check(arguments.check, designs, arguments.out, arguments.sets, arguments.noise, arguments.model)
    write_set(arguments.design, arguments.out, arguments.focal / 1e3, arguments.seed, arguments.frames, arguments.noise, arguments.model)


if __name__ == "__main__":
    main()
