#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Standard errors of plenoptic calibrations against the truth, over image sets of random cameras.

    bench/plenoptic_nees PLENOCAL OUT [--sets 40] [--first 0] [--tilt 8] [--quarter] [--large] [--points]

Each set is one camera of a small sensor: f_L of 8 to 50 mm, one or three lens types, Galilean or Keplerian, micro images of
12 to 40 px, grey or mosaic, AprilGrids or chessboards, several noise levels. Its images are traced here, ray by ray from the
sensor through thin micro lenses, the main lens' stop and its thin lens to the target: no line of it is a formula of
models/start/plenoptic_model.h, which knows micro lenses as pinholes and no stop. A set that is there already is not rendered
or calibrated again. Prints (estimate - truth) / sigma of all parameters, the means of their squares, and NEES / n: chi-square
of a set's n parameters together over n, with the interval in which 99 % of its means are (correlated errors scatter more).
--tilt: arrays tilted by so many mrad, calibrated by focused-plenoptic-tilt; without the tilt too, and prints what
`array_tilted` states. --quarter: two lens types, one lens in four of the second. --large: 2048 x 2048 px, f_L 16 mm, three
types, with a stereo pair. --points: no images, but places where straight lines through the micro lenses' middles meet the sensor,
with noise of 0.02 px, of chessboards; every second array is tilted by --tilt.
Needs python3-numba, python3-numpy, python3-opencv, python3-scipy, python3-yaml.
"""
import pathlib
import sys

import cv2
import numba
import numpy as np
from scipy.stats import chi2

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import plenoptic_distortion, plenoptic_undistorted
from common import load, save

NAMES = ("f_L", "b_L0", "B", "c_x", "c_y", "A_0", "A_1", "B_0", "B_1")
SAMPLES = 15  # along either side of a micro lens; as many points of the pixel


def interval(n):
    """In which 99 % of the means of n squares of standard normal numbers are."""
    return chi2.ppf([0.005, 0.995], n) / n


def rotation(axis_angle):
    return cv2.Rodrigues(np.asarray(axis_angle, float))[0]


def points_of_disc():
    """Points of a micro lens, radius 1."""
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES * 2 - 1
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    return grid[(grid**2).sum(1) < 1]


@numba.njit(error_model="numpy")
def ramp(x):
    return max(x, 0)**2


@numba.njit(error_model="numpy")
def reaches_stop(place, right, down, c, inverse_f, tilt, B, b_L0, stop, reach):
    """False where no ray from a pixel through a micro lens passes the main lens' stop; true for all others, and for some more."""
    delta = c[0] * tilt[0] + c[1] * tilt[1]
    magnified = (b_L0 - delta) / (B + delta)
    x, y = c[0] * (1 + magnified) - place[0] * magnified, c[1] * (1 + magnified) - place[1] * magnified
    spread = abs(1 + magnified - (b_L0 - delta) * inverse_f) * reach + magnified * (abs(right[0] + down[0]) + abs(right[1] + down[1]))
    return x * x + y * y < (1.1 * stop + 1.5 * spread)**2


@numba.njit(error_model="numpy")
def white_light(place, right, down, near, lenses, inverse_f, tilt, B, b_L0, stop, points):
    light, reach = np.zeros(len(place)), np.abs(points).max()
    for i in range(len(place)):
        for lens in near[i]:
            c = lenses[lens]
            if not reaches_stop(place[i], right[i], down[i], c, inverse_f[lens], tilt, B, b_L0, stop, reach):
                continue
            for a in points:
                delta = (c[0] + a[0]) * tilt[0] + (c[1] + a[1]) * tilt[1]
                to_main = b_L0 - delta
                magnified = to_main / (B + delta)  # from the sensor to the main lens
                by_aperture = 1 + magnified - to_main * inverse_f[lens]
                x = c[0] * (1 + magnified) - place[i, 0] * magnified + by_aperture * a[0]  # at the main lens
                y = c[1] * (1 + magnified) - place[i, 1] * magnified + by_aperture * a[1]
                distance = np.sqrt(x * x + y * y)
                # The pixel at the main lens is a parallelogram with these half sides across the stop's edge.
                u = abs(right[i, 0] * x + right[i, 1] * y) / distance * magnified / 2
                v = abs(down[i, 0] * x + down[i, 1] * y) / distance * magnified / 2
                long, short = max(u, v), max(min(u, v), 1e-12)
                inward = stop - distance
                light[i] += (ramp(inward + long + short) - ramp(inward + long - short) - ramp(inward - long + short)
                             + ramp(inward - long - short)) / (8 * long * short)
    return light


@numba.njit(error_model="numpy")
def traced_light(place, right, down, near, lenses, inverse_f, tilt, B, b_L0, f_L, stop, points, aside, shift, R, t, texture, scale):
    """Light of each board, (boards, pixels): of each point of the micro lenses' apertures a ray from a point of the pixel.
    The points of a pixel are `aside` plus its `shift`, modulo 1: sampling makes noise, no pattern common to all pixels."""
    light, reach = np.zeros((len(R), len(place))), np.abs(points).max()
    rows, columns = texture.shape
    for i in range(len(place)):
        for lens in near[i]:
            if not reaches_stop(place[i], right[i], down[i], lenses[lens], inverse_f[lens], tilt, B, b_L0, stop, reach):
                continue
            for k in range(len(points)):
                a0, a1 = points[k]
                m0, m1 = lenses[lens, 0] + a0, lenses[lens, 1] + a1
                u, v = (aside[k, 0] + shift[i, 0]) % 1 - 0.5, (aside[k, 1] + shift[i, 1]) % 1 - 0.5
                s0 = place[i, 0] + right[i, 0] * u + down[i, 0] * v
                s1 = place[i, 1] + right[i, 1] * u + down[i, 1] * v
                delta = m0 * tilt[0] + m1 * tilt[1]
                slope0 = (m0 - s0) / (B + delta) - a0 * inverse_f[lens]  # behind the micro lens
                slope1 = (m1 - s1) / (B + delta) - a1 * inverse_f[lens]
                o0, o1 = m0 + slope0 * (b_L0 - delta), m1 + slope1 * (b_L0 - delta)
                if o0 * o0 + o1 * o1 >= stop * stop:
                    continue
                # The scene is turned by 180 degrees against the sensor.
                d0, d1 = o0 / f_L - slope0, o1 / f_L - slope1
                o0, o1 = -o0, -o1
                for b in range(len(R)):
                    n0, n1, n2 = R[b, 0, 2], R[b, 1, 2], R[b, 2, 2]
                    z = (n0 * (t[b, 0] - o0) + n1 * (t[b, 1] - o1) + n2 * t[b, 2]) / (d0 * n0 + d1 * n1 + n2)  # on the plane through t
                    p0, p1, p2 = o0 + z * d0 - t[b, 0], o1 + z * d1 - t[b, 1], z - t[b, 2]
                    x = (p0 * R[b, 0, 0] + p1 * R[b, 1, 0] + p2 * R[b, 2, 0]) * scale
                    y = (p0 * R[b, 0, 1] + p1 * R[b, 1, 1] + p2 * R[b, 2, 1]) * scale
                    column, row = int(np.floor(x)), int(np.floor(y))
                    if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
                        light[b, i] += 0.8
                        continue
                    x, y = x - column, y - row
                    light[b, i] += ((1 - y) * ((1 - x) * texture[row, column] + x * texture[row, column + 1])
                                    + y * ((1 - x) * texture[row + 1, column] + x * texture[row + 1, column + 1]))
    return light


class Optics:
    """A camera; lengths in metres, image coordinates upright (the physical ones turned by 180 degrees)."""

    def __init__(self, seed, tilt, quarter, large, points=False):
        random = np.random.default_rng(seed)
        self.random = random
        self.pixel = 5.5e-6
        pitch = random.uniform(12, 40)  # px
        self.size = int(np.clip(26 * pitch, 420, 720))
        f_L = np.exp(random.uniform(np.log(8e-3), np.log(50e-3)))
        if large:
            pitch, self.size, f_L = 23.2, 2048, 16e-3
        B = pitch * self.pixel * random.uniform(2.2, 4)
        keplerian = random.random() < 0.25 and not large
        # Virtual depths (v_P) of the target's nearest and farthest point, and at infinity.
        if keplerian:
            infinity, near, far = -6.0, -2.6, -5.0
        else:
            infinity, near, far = 2.0, 5.0, 2.8
        b_L0 = f_L - infinity * B
        self.distance = [f_L + f_L**2 / ((v - infinity) * B) for v in (near, far)]
        half = self.size * self.pixel / 2
        self.parameters = dict(f_L=f_L, b_L0=b_L0, B=B, c_x=self.size / 2 + random.uniform(-12, 12),
                               c_y=self.size / 2 + random.uniform(-12, 12), A_0=random.uniform(-0.004, 0.004) / half**2,
                               A_1=random.uniform(-0.001, 0.001) / half**4, B_0=random.uniform(-3e-4, 3e-4) / half,
                               B_1=random.uniform(-3e-4, 3e-4) / half)
        focus = np.quantile([near, far], (0.15, 0.5, 0.85)) if random.random() < 0.5 or large else [(near + far) / 2]
        if quarter:
            focus = np.quantile([near, far], (0.25, 0.75))
        self.f_micro = np.array([B * v / (v - 1) for v in focus])
        self.stop = 0.46 * pitch * self.pixel * b_L0 / B * random.uniform(0.95, 1)
        self.aperture = 0.35 * pitch * self.pixel * b_L0 / (b_L0 + B)
        self.full_well = random.choice([5000, 10000, 30000])
        self.mosaic = random.random() < 0.3 and not large
        self.chessboard = random.random() < 0.3 and not large
        angle = random.uniform(0, np.pi / 3)
        basis = pitch * self.pixel * np.array([[np.cos(angle), np.cos(angle + np.pi / 3)],
                                               [np.sin(angle), np.sin(angle + np.pi / 3)]])
        offset = random.uniform(-0.5, 0.5, 2) * pitch * self.pixel
        reach = int(1.2 * self.size / pitch) + 3
        nodes = np.array([(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)])
        lenses = (nodes @ basis.T + offset) * (b_L0 / (b_L0 + B))
        around = random.uniform(0, 2 * np.pi) if tilt else 0
        self.tilt = 1e-3 * tilt * np.array([np.cos(around), np.sin(around)])
        if tilt:
            self.parameters.update(t_x=self.tilt[0], t_y=self.tilt[1])
        centres = lenses * ((b_L0 + B) / (b_L0 - lenses @ self.tilt))[:, None]  # of micro images, undistorted
        keep = np.abs(centres).max(axis=1) < half + 30 * self.pixel
        types = (nodes % 2).max(axis=1) ^ 1 if quarter else ((nodes[:, 0] - nodes[:, 1]) % 3) % len(focus)
        self.lenses, self.centres, self.types = lenses[keep], centres[keep], types[keep]
        self.basis, self.offset, self.pitch = basis, offset, pitch
        self.index = {tuple(node): k for k, node in enumerate(nodes[keep])}
        if not points:
            self.find_pixels()

    def in_image(self, place):
        """Raw px of an undistorted place on the sensor."""
        p = self.parameters
        return (place + plenoptic_distortion(place, p)) / self.pixel + [p["c_x"], p["c_y"]]

    def seen_through(self, lens, points):
        """Where lines from the main lens' images of `points` through a micro lens meet the sensor; and which are well inside its micro image."""
        p, L, delta = self.parameters, self.lenses[lens], self.lenses[lens] @ self.tilt
        distance = p["f_L"] * points[:, 2] / (points[:, 2] - p["f_L"])  # of the images from the main lens
        images = points[:, :2] * (distance / points[:, 2])[:, None]
        place = L + (images - L) * ((p["B"] + delta) / (distance - p["b_L0"] + delta))[:, None]
        return place, np.linalg.norm(place - self.centres[lens], axis=1) < 0.35 * self.pitch * self.pixel

    def find_pixels(self):
        """Undistorted place of each pixel and of its right and lower neighbour, and the three nearest micro lenses."""
        p = self.parameters
        y, x = np.mgrid[:self.size, :self.size]
        goal = (np.stack([x, y], -1).reshape(-1, 2) - [p["c_x"], p["c_y"]]) * self.pixel

        self.place = plenoptic_undistorted(goal, p)
        self.right = plenoptic_undistorted(goal + [self.pixel, 0], p) - self.place
        self.down = plenoptic_undistorted(goal + [0, self.pixel], p) - self.place
        from scipy.spatial import cKDTree
        self.near = cKDTree(self.centres).query(self.place, k=3)[1]

    def white(self):
        """Light of a white field. Pixels are integrated exactly, so that the lattice is not worse than its noise."""
        p = self.parameters
        return white_light(self.place, self.right, self.down, self.near, self.lenses, (1 / self.f_micro)[self.types],
                           self.tilt, p["B"], p["b_L0"], self.stop, points_of_disc() * self.aperture)

    def images(self, boards, texture, scale):
        """White field and images of boards; `boards`: R, t of the board in the camera, `scale`: texture px per m."""
        p = self.parameters
        grid = points_of_disc()
        spread = np.array([[((i + 1) * 0.7548776662) % 1, ((i + 1) * 0.5698402910) % 1] for i in range(len(grid))])
        light = traced_light(self.place, self.right, self.down, self.near, self.lenses, (1 / self.f_micro)[self.types], self.tilt, p["B"],
                             p["b_L0"], p["f_L"], self.stop, grid * self.aperture, spread[self.random.permutation(len(grid))],
                             self.random.random((len(self.place), 2)), np.array([R for R, _ in boards]), np.array([t for _, t in boards]), texture, scale)
        light = np.concatenate([self.white()[None], light])
        return (light / np.quantile(light[0], 0.99)).reshape(-1, self.size, self.size).astype(np.float32)

    def grey(self, light):
        """8 bits with blur of the pixels, shot and read noise."""
        electrons = 0.75 * self.full_well * cv2.GaussianBlur(light, (0, 0), 0.35)
        if self.mosaic:
            electrons[::2, ::2] *= 0.6
            electrons[1::2, 1::2] *= 0.7
        electrons = electrons + self.random.normal(size=light.shape) * np.sqrt(np.maximum(electrons, 0) + 64)
        return np.clip(np.rint(electrons * 255 / self.full_well), 0, 255).astype(np.uint8)


class OrdinaryCamera:
    """A camera of the pair, 1280 x 1024 px, beside the plenoptic one."""

    def __init__(self, random, side):
        self.K = np.array([[1350 + random.uniform(-20, 20), 0, 640 + random.uniform(-9, 9)], [0, 1350, 512 + random.uniform(-9, 9)], [0, 0, 1]])
        self.distortion = np.array([-0.1, 0.05, 4e-4, -3e-4])
        self.R, self.t = rotation([0.01, -0.15 * side, 0.005 * side]), np.array([-0.08 * side, 0.002, 0.003])  # from the plenoptic camera

    def image(self, board, texture, scale, random):
        """16 samples a pixel, blur, noise."""
        R, t = self.R @ board[0], self.R @ board[1] + self.t
        y, x = np.mgrid[:4 * 1024, :4 * 1280]
        pixels = (np.stack([x, y], -1).reshape(-1, 1, 2) - 1.5) / 4
        slope = cv2.undistortPoints(pixels, self.K, self.distortion).reshape(-1, 2)
        onto = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
        place = np.column_stack([slope, np.ones(len(slope))]) @ onto.T
        place = (place[:, :2] / place[:, 2:] * scale).astype(np.float32).reshape(4 * 1024, 4 * 1280, 2)
        value = cv2.remap(texture, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.8)
        light = cv2.GaussianBlur(cv2.resize(value, (1280, 1024), interpolation=cv2.INTER_AREA), (0, 0), 0.5)
        return np.clip(np.rint(200 * light + random.normal(size=light.shape) * 2), 0, 255).astype(np.uint8)


def draw_boards(camera, centre, images=12):
    """R, t of the board in the camera; `centre`: of the board in its own coordinates, m."""
    random, p = camera.random, camera.parameters
    near, far = camera.distance
    boards = []
    for _ in range(images):
        z = np.exp(random.uniform(np.log(near * 1.15), np.log(far * 0.9)))
        lean, around = random.uniform(0.35, 0.7), random.uniform(0, 2 * np.pi)
        R = rotation([lean * np.cos(around), lean * np.sin(around), 0]) @ rotation([0, 0, random.uniform(-0.4, 0.4)])
        aside = 0.25 * camera.size * camera.pixel / (p["b_L0"] + p["B"]) * z * random.uniform(-1, 1, 2)
        boards.append((R, np.array([aside[0], aside[1], z]) - R[:, :2] @ centre))
    return boards


def board_width(camera):
    return 0.75 * np.sqrt(np.prod(camera.distance)) * camera.size * camera.pixel / (camera.parameters["b_L0"] + camera.parameters["B"])


def write_truth(folder, camera, target, **more):
    description = dict(parameters={key: float(value) for key, value in camera.parameters.items()}, pitch=float(camera.pitch),
                       types=len(camera.f_micro), f_micro=[float(f) for f in camera.f_micro], mosaic=bool(camera.mosaic),
                       target=target["type"], full_well=int(camera.full_well), size=camera.size, **more)
    save(folder / "truth.yaml", description)


def model_of(tilt):
    return "focused-plenoptic-tilt" if tilt else "focused-plenoptic"


def write_points(folder, seed, tilt, noise=0.02):
    camera = Optics(seed, tilt, False, False, points=True)
    square = board_width(camera) / 9
    target = dict(type="chessboard", columns=8, rows=7, square=float(square))
    save(folder / "target.yaml", target)
    places = square * np.array([[column, row] for row in range(7) for column in range(8)])
    lines = ["frame,marker,x,y,lens_x,lens_y,sigma"]
    centres = camera.in_image(camera.centres)
    for frame, (R, t) in enumerate(draw_boards(camera, square * np.array([3.5, 3]))):
        points = places @ R[:, :2].T + t
        for lens, centre in enumerate(centres):
            place, inside = camera.seen_through(lens, points)
            seen = camera.in_image(place) + camera.random.normal(size=place.shape) * noise
            inside &= ((seen > 0) & (seen < camera.size - 1)).all(axis=1)
            lines += [f"{frame:03},{marker},{seen[marker, 0]:.9f},{seen[marker, 1]:.9f},{centre[0]:.9f},{centre[1]:.9f},{noise}"
                      for marker in np.flatnonzero(inside)]
    (folder / "points.csv").write_text("\n".join(lines) + "\n")
    save(folder / "session.yaml", dict(target="target.yaml", cameras=dict(plenoptic=dict(
        model=model_of(tilt), detections="points.csv", image_size=[camera.size] * 2, pixel_size=camera.pixel))))
    write_truth(folder, camera, target)


def write_set(folder, seed, tilt, quarter, large):
    camera = Optics(seed, tilt, quarter, large)
    p, random = camera.parameters, camera.random
    width = board_width(camera)
    if camera.chessboard:
        square = width / 9
        target = dict(type="chessboard", columns=8, rows=7, square=float(square))
        columns, rows = 9, 8
        texture = np.full((rows * 60, columns * 60), 0.85, np.float32)
        for r in range(rows):
            for c in range(columns):
                if (r + c) % 2 == 0:
                    texture[r * 60:r * 60 + 60, c * 60:c * 60 + 60] = 0.05
        scale, origin = 60 / square, np.array([60.0, 60.0])  # the first inner corner is the target's origin
    else:
        size = width / (5 + 4 * 0.3)
        target = dict(type="aprilgrid", columns=5, rows=5, size=float(size), spacing=0.3)
        texture, scale, origin = tag_texture(size, 5, 5)
    save(folder / "target.yaml", target)
    pad = 40
    texture = cv2.copyMakeBorder(texture, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=0.85)
    origin = origin + pad
    centre = np.array([texture.shape[1] / 2, texture.shape[0] / 2])
    boards = draw_boards(camera, centre / scale)
    light = camera.images(boards, texture - 0.0, scale)
    for name in ("raw", "white"):
        (folder / name).mkdir(exist_ok=True)
    for k in range(len(boards)):
        cv2.imwrite(str(folder / f"raw/{k:03}.png"), camera.grey(light[1 + k]))
    for k in range(5):
        cv2.imwrite(str(folder / f"white/{k}.png"), camera.grey(light[0]))
    session = dict(target="target.yaml", cameras=dict(plenoptic=dict(
        model=model_of(tilt), images="raw/*.png", white_images="white/*.png", pixel_size=camera.pixel)))
    if camera.mosaic:
        session["cameras"]["plenoptic"]["bayer"] = "RGGB"
    poses = [[*map(float, cv2.Rodrigues(R)[0].ravel()), *map(float, t)] for R, t in boards]  # of the texture's corner, m
    if large:
        for name, side in (("left", -1), ("right", 1)):
            ordinary = OrdinaryCamera(random, side)
            (folder / name).mkdir(exist_ok=True)
            for k, board in enumerate(boards):
                cv2.imwrite(str(folder / name / f"{k:03}.png"), ordinary.image(board, texture, scale, random))
            session["cameras"][name] = dict(model="pinhole-radtan4", images=f"{name}/*.png")
    save(folder / "session.yaml", session)
    write_truth(folder, camera, target, poses=poses, texture_scale=float(scale), origin=[float(x) for x in origin])


def tilt_named(program, folder):
    """What `array_tilted` states of a calibration without the tilt."""
    session = load(folder / "session.yaml")
    session["cameras"]["plenoptic"]["model"] = "focused-plenoptic"
    save(folder / "parallel.yaml", session)
    result = common.calibrate(program, folder / "parallel.yaml", folder / "parallel")
    stated = [finding["what"] for finding in result["verdict"]["findings"] if finding["code"] == "array_tilted"]
    return f"{result['verdict']['grade']}: {stated[0] if stated else 'no tilt named'}"


def tag_texture(size, columns, rows):
    """Picture of Kalibr's AprilGrid (borders of two bits, black squares), texture px per m, and the place of the target's origin in it."""
    dictionary = cv2.aruco.Dictionary_get(cv2.aruco.DICT_APRILTAG_36h11)
    cell = 20  # px
    tag, gap = 10 * cell, 3 * cell
    step = tag + gap
    texture = np.full((rows * step + gap, columns * step + gap), 0.85, np.float32)
    for row in range(rows):
        for column in range(columns):
            # OpenCV draws the tags of this family turned by 180 degrees against the AprilTag library.
            picture = cv2.rotate(cv2.aruco.drawMarker(dictionary, row * columns + column, tag, borderBits=2), cv2.ROTATE_180)
            top, left = (rows - 1 - row) * step + gap, column * step + gap
            texture[top:top + tag, left:left + tag] = np.where(picture > 0, 0.85, 0.05)
    for top in range(0, texture.shape[0], step):
        for left in range(0, texture.shape[1], step):
            texture[top:top + gap, left:left + gap] = 0.05
    return texture, tag / size, np.array([gap, gap])


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--tilt", type=float, default=0)
    parser.add_argument("--quarter", action="store_true")
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--points", action="store_true")
    arguments = parser.parse_args()
    names = NAMES + (("t_x", "t_y") if arguments.tilt else ())
    errors = {name: [] for name in names}  # in sigmas
    chi_squares, counts = [], []
    print("set  " + "".join(f"{name:>7}" for name in names) + " NEES/n  camera")
    for seed in range(arguments.first, arguments.first + arguments.sets):
        tilt = arguments.tilt if not arguments.points or seed % 2 else 0
        folder = arguments.out / f"{seed:02}"
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / "truth.yaml").exists():
            if arguments.points:
                write_points(folder, seed, tilt)
            else:
                write_set(folder, seed, tilt, arguments.quarter, arguments.large)
        truth = load(folder / "truth.yaml")
        result = folder / "result/calibration.yaml"
        if not result.exists():
            try:
                common.calibrate(arguments.program, folder / "session.yaml", folder / "result")
            except common.Failed as failure:
                print(f"{seed:3}  not calibrated: {failure}", flush=True)
                continue
        camera = load(result)["cameras"]["plenoptic"]
        z, chi_square = common.errors_in_sigmas(camera, truth)
        chi_squares.append(chi_square)
        counts.append(len(z))
        for name in z:
            errors[name].append(z[name])
        line = f"{seed:3}  " + "".join(f"{z[name]:7.2f}" if name in z else "       " for name in names) + f"{chi_square:7.2f}"
        p = truth["parameters"]
        print(line + f"  f_L {1e3 * p['f_L']:.1f} mm, pitch {truth['pitch']:.1f} px, {truth['types']} types, {truth['target']}"
              f"{', mosaic' if truth['mosaic'] else ''}{', Keplerian' if p['b_L0'] > p['f_L'] else ''}, {len(camera.get('lens_types', []))} types found", flush=True)
        if arguments.tilt and not arguments.points:
            print(f"     {tilt_named(arguments.program, folder)}", flush=True)
    print("mean square" + "".join(f" {name} {common.mean_square(errors[name]):.2f}" for name in names))
    print("mean of" + "".join(f" {name} {np.mean(errors[name]):.2f}" for name in names))
    everything = np.concatenate([errors[name] for name in names])**2
    print(f"mean square of all {everything.mean():.2f}; above 4 sigma {np.mean(everything > 16):.1%} of {len(everything)}")
    print("NEES / n {:.3f}, 99 % interval {:.2f} to {:.2f}".format(np.average(chi_squares, weights=counts), *interval(sum(counts))))


if __name__ == "__main__":
    main()
