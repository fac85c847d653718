# SPDX-License-Identifier: Apache-2.0
"""Cameras, boards, rigs and their points in numpy, for bench/honest: written from docs/models.md, docs/plenoptic.md and
docs/formats.md, without the program, so that its own formulas are not held against themselves."""
import struct
import zlib

import numpy as np

from accuracy.geometry import difference, numbers, transform, translation_matrix
from accuracy.geometry import exp_rotation as exp
from accuracy.geometry import log_rotation as log
from common import load, read_table, save


def se3_log(T):
    w = log(T[:3, :3])
    V = translation_matrix(w) if np.linalg.norm(w) > 1e-9 else np.eye(3)
    return np.concatenate([np.linalg.solve(V, T[:3, 3]), w])


def retract(T, d):
    """The chart of the conventions: R' = exp(w) R, t' = t + v."""
    return transform(exp(d[3:]) @ T[:3, :3], T[:3, 3] + d[:3])


def chart(T, truth):
    return np.concatenate([T[:3, 3] - truth[:3, 3], log(T[:3, :3] @ truth[:3, :3].T)])


# --- cameras ---

PX = ["f_x", "f_y", "c_x", "c_y"]
LENSES = {  # distortion of a typical lens, largest tangent or angle off the axis that is used
    "pinhole": ({}, 1.2),
    "pinhole-radial3": ({"A_0": -0.2, "A_1": 0.06, "A_2": -0.01}, 1.1),
    "pinhole-radtan": ({"k_1": -0.21, "k_2": 0.07, "p_1": 4e-4, "p_2": -6e-4, "k_3": -0.012}, 1.1),
    "kannala-brandt4": ({"k_1": -0.02, "k_2": 0.004, "k_3": -0.003, "k_4": 0.0007}, 1.35)}
LENSES["kannala-brandt4+pupil"] = (LENSES["kannala-brandt4"][0] | {"e_0": 0.003, "e_1": -0.001, "e_2": 0.0005}, 1.35)


def axis_point(p, X):
    """z of the points of the axis through which the rays to X go: repeated substitution, not Newton's method."""
    z_p = np.zeros(len(X))
    for _ in range(60):
        theta = np.arctan2(np.hypot(X[:, 0], X[:, 1]), X[:, 2] - z_p)
        t2 = theta**2
        z_p = (1 / np.sinc(theta / np.pi) - 1) * (p["e_0"] + t2 * (p["e_1"] + t2 * p["e_2"]))
    return z_p


def project(model, p, X):
    """Image points of X (n x 3, camera frame), NaN where the lens is not defined or not used."""
    x, y, z = X.T
    if model.endswith("+pupil"):
        z = z - axis_point(p, X)
    with np.errstate(all="ignore"):
        if model.startswith("kannala-brandt4"):
            r = np.hypot(x, y)
            theta = reach = np.arctan2(r, z)
            t2 = theta**2
            g = theta * (1 + t2 * (p["k_1"] + t2 * (p["k_2"] + t2 * (p["k_3"] + t2 * p["k_4"])))) / np.maximum(r, 1e-300)
            m = np.stack([x * g, y * g], 1)
        else:
            x, y = x / z, y / z
            s = x * x + y * y
            reach = np.where(z > 0, np.sqrt(s), np.inf)
            a = [p.get(k, 0) for k in (("A_0", "A_1", "A_2") if model == "pinhole-radial3" else ("k_1", "k_2", "k_3"))]
            g = 1 + s * (a[0] + s * (a[1] + s * a[2]))
            p1, p2 = p.get("p_1", 0), p.get("p_2", 0)
            m = np.stack([x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y], 1)
        u = m * [p["f_x"], p["f_y"]] + [p["c_x"], p["c_y"]]
    u[~(reach < LENSES[model][1])] = np.nan
    return u


class Camera:
    def __init__(self, model="pinhole-radial3", size=(640, 480), f=560.0, T=None, random=None):
        w, h = size
        self.model, self.size, self.T = model, size, np.eye(4) if T is None else T
        jitter = random.normal(0, 1, 4) if random is not None else np.zeros(4)
        self.p = {"f_x": f * (1 + 0.02 * jitter[0]), "f_y": f * (1 + 0.02 * jitter[1]), "c_x": w / 2 + 5 * jitter[2],
                  "c_y": h / 2 + 5 * jitter[3], **LENSES[model][0]}

    def points(self, X):
        u = project(self.model, self.p, X)
        with np.errstate(invalid="ignore"):
            u[~((u > 0) & (u < np.array(self.size) - 1)).all(1)] = np.nan
        return u


def rays(camera, pixels):
    """(X / Z, Y / Z) of what pixels show; NaN outside of the lens' range."""
    u = np.asarray(pixels, float)
    f = [camera.p["f_x"], camera.p["f_y"]]
    m = (u - [camera.p["c_x"], camera.p["c_y"]]) / f
    for _ in range(40):  # fixed-point steps
        back = project(camera.model, camera.p, np.hstack([m, np.ones((len(m), 1))]))
        m = m - np.nan_to_num(back - u) / f
        if np.nanmax(abs(back - u)) < 1e-6:
            break
    m[~(np.linalg.norm(back - u, axis=1) < 1e-3)] = np.nan
    return m


# --- boards, rigs, views ---

class Board:
    """`points` are the true ones; `nominal` those of the file."""

    def __init__(self, columns=9, rows=7, square=0.03, T=None, tolerance=0.0, random=None):
        self.columns, self.rows, self.square, self.tolerance = columns, rows, square, tolerance
        grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2) * square
        self.nominal = np.hstack([grid, np.zeros((len(grid), 1))])
        self.points = self.nominal + (random.normal(0, tolerance, self.nominal.shape) if tolerance else 0)
        self.T = np.eye(4) if T is None else T  # T_first_own
        self.centre = self.nominal.mean(0)

    def yaml(self):
        return {"type": "chessboard", "columns": self.columns, "rows": self.rows,
                "square": f"{1e3 * self.square:.9g} mm", **({"tolerance": f"{1e3 * self.tolerance:.9g} mm"} if self.tolerance else {})}


class Rig:
    def __init__(self, cameras, boards):
        self.cameras, self.boards = cameras, boards  # dicts by name, the first is master and first target
        self.frames = {}  # name: T_rig_first

    def view(self, random, camera, board, distance, tilt=0.7, roll=0.6):
        """A frame in which `camera` sees `board` whole at the relative distance (of 1: the board fills most of the image)."""
        cam, target = self.cameras[camera], self.boards[board]
        w, h = cam.size
        extent = np.ptp(target.nominal, axis=0)[:2]
        near = max(extent[0] * cam.p["f_x"] / w, extent[1] * cam.p["f_y"] / h)
        for _ in range(200):
            z = near * random.uniform(*distance)
            aside = np.array([w / cam.p["f_x"], h / cam.p["f_y"]]) * random.uniform(-0.4, 0.4, 2) * z
            around = random.uniform(0, 2 * np.pi)
            R = exp(random.uniform(0, tilt) * np.array([np.cos(around), np.sin(around), 0])) @ exp([0, 0, random.uniform(-roll, roll)])
            T = transform(R, np.array([*aside, z]) - R @ target.centre)
            u = cam.points(target.points @ T[:3, :3].T + T[:3, 3])
            if not np.isnan(u).any():
                return np.linalg.inv(cam.T) @ T @ np.linalg.inv(target.T)
        raise RuntimeError("the board does not fit into the image")

    def add_views(self, random, count, distance=(1.1, 2.5), **more):
        """Frames that aim each camera at each board in turn."""
        pairs = [(c, b) for b in self.boards for c in self.cameras]
        for k in range(count):
            self.frames[f"{len(self.frames):03}"] = self.view(random, *pairs[k % len(pairs)], distance, **more)

    def seen(self, camera, T_rig_first, board):
        cam, target = self.cameras[camera], self.boards[board]
        T = cam.T @ T_rig_first @ target.T
        return cam.points(target.points @ T[:3, :3].T + T[:3, 3])

    def measure(self, random, noise=0.1, outliers=0.0, uneven=False, poses_of=None, shared=None, fewest=6, stated=1.0):
        """Rows (frame, number, x, y, sigma) by camera, and the true points in `self.truth`. `poses_of(camera, frame)` gives
        a pose of a view's own, `shared(random, camera)` displacements, `stated` is the factor by which stated sigmas are wrong."""
        self.truth, rows = {}, {}
        for name in self.cameras:
            rows[name], displaced = [], shared(random, self.cameras[name]) if shared else None
            for frame, T in self.frames.items():
                for b, board in enumerate(self.boards):
                    u = self.seen(name, poses_of(name, frame) if poses_of else T, board)
                    inside = np.flatnonzero(~np.isnan(u[:, 0]))
                    if len(inside) < fewest:
                        continue
                    for i in inside:
                        u[i] += displaced(frame, i, u[i]) if shared else 0
                        sigma = noise * (np.exp(random.uniform(-1.2, 1.2)) if uneven else 1)
                        x = u[i] + random.normal(0, sigma, 2)
                        if random.random() < outliers:
                            x += random.uniform(3, 40) * exp([0, 0, random.uniform(0, 2 * np.pi)])[:2, 0]
                        rows[name].append((frame, 100000 * b + i, *x, stated * sigma))
                        self.truth[name, frame, 100000 * b + i] = (u[i], x)
        return rows

    def write(self, folder, rows, options=None, session=None, sigma=True, cameras=None):
        folder.mkdir(exist_ok=True)
        content = {"cameras": {}, **(session or {})}
        names = {}
        for name, board in self.boards.items():
            save(folder / f"{name}.yaml", board.yaml())
            names[name] = f"{name}.yaml"
        content.update({"target": next(iter(names.values()))} if len(names) == 1 else {"targets": names})
        for name, cam in self.cameras.items():
            content["cameras"][name] = {"model": cam.model, "image_size": list(cam.size), "detections": f"detections_{name}.csv",
                                        **((cameras or {}).get(name, {}))}
            lines = ["frame,marker,x,y" + (",sigma" if sigma else "")]
            lines += [f"{f},{m},{x:.6f},{y:.6f}" + (f",{s:.6g}" if sigma else "") for f, m, x, y, s in rows[name]]
            (folder / f"detections_{name}.csv").write_text("\n".join(lines) + "\n")
        if options:
            content["options"] = options
        save(folder / "session.yaml", content)

    # --- normal matrix by finite differences ---

    def normal_matrix(self, rows):
        """Names and information of parameters, extrinsics and boards' poses (charts), frames' poses eliminated; no priors."""
        cams, boards = list(self.cameras), list(self.boards)
        names = [f"{c}.{k}" for c in cams for k in self.cameras[c].p]
        six = ["x", "y", "z", "w_x", "w_y", "w_z"]
        names += [f"{c}.T_camera_rig.{k}" for c in cams[1:] for k in six] + [f"{b}.{k}" for b in boards[1:] for k in six]
        at = {n: i for i, n in enumerate(names)}
        S = np.zeros((len(names), len(names)))
        groups = {}
        for c in cams:
            for frame, number, _, _, sigma in rows[c]:
                groups.setdefault(frame, {}).setdefault((c, number // 100000), []).append((number % 100000, sigma))
        for frame, views in groups.items():
            A, pose = np.zeros_like(S), np.zeros((6, 6))
            mixed = np.zeros((len(names), 6))
            for (c, b), points in views.items():
                cam, board = self.cameras[c], self.boards[boards[b]]
                index = [i for i, _ in points]
                weight = np.repeat([1 / s for _, s in points], 2)

                def predict(p, Tc, Tf, Tb):
                    T = Tc @ Tf @ Tb
                    return project(cam.model, p, board.points[index] @ T[:3, :3].T + T[:3, 3]).ravel() * weight
                base = (cam.p, cam.T, self.frames[frame], board.T)

                def derivative(which, change, step):
                    plus, minus = list(base), list(base)
                    plus[which], minus[which] = change(base[which], step), change(base[which], -step)
                    return (predict(*plus) - predict(*minus)) / (2 * step)
                columns, J = [], []
                for k in cam.p:
                    columns.append(at[f"{c}.{k}"])
                    step = 1e-2 if k in PX else 1e-5
                    J.append(derivative(0, lambda p, s: {**p, k: p[k] + s}, step))
                move = lambda j: lambda T, s: retract(T, s * np.eye(6)[j])
                if c != cams[0]:
                    columns += [at[f"{c}.T_camera_rig.{k}"] for k in six]
                    J += [derivative(1, move(j), 1e-6) for j in range(6)]
                if b:
                    columns += [at[f"{boards[b]}.{k}"] for k in six]
                    J += [derivative(3, move(j), 1e-6) for j in range(6)]
                J = np.array(J).T
                Jp = np.array([derivative(2, move(j), 1e-6) for j in range(6)]).T
                A[np.ix_(columns, columns)] += J.T @ J
                mixed[columns] += J.T @ Jp
                pose += Jp.T @ Jp
            S += A - mixed @ np.linalg.solve(pose, mixed.T)
        return names, S


# --- what the program wrote, against the truth ---

def pair(errors, sigmas):
    return [np.ravel(np.asarray(errors, float)).tolist(), np.ravel(np.asarray(sigmas, float)).tolist()]


def compare(out, rig):
    """{what: (errors, sigmas)} of a calibration of `rig` in the folder `out`."""
    found = load(out / "calibration.yaml")
    values = {}

    def add(what, errors, sigmas):
        errors, sigmas = np.ravel(errors), np.ravel(numbers(np.ravel(sigmas)))
        keep = sigmas > 0  # 0: held
        old = values.get(what, ([], []))
        values[what] = pair([*old[0], *errors[keep]], [*old[1], *sigmas[keep]])
    deviation = {}
    for name, cam in rig.cameras.items():
        c = found["cameras"][name]
        error = {k: float(c["parameters"][k]) - v for k, v in cam.p.items()}
        T = np.array(c["T_camera_rig"], float)
        deviation.update({f"{name}.{k}": (e, float(c["sigma"][k])) for k, e in error.items()})
        for key, what in (("sigma", "parameters"), ("sigma_jackknife", "jackknife")):
            if key in c:
                add(what, list(error.values()), [c[key][k] for k in error])
        six = chart(T, cam.T)
        deviation.update({f"{name}.T_camera_rig.{k}": (six[j], None) for j, k in enumerate(("x", "y", "z", "w_x", "w_y", "w_z"))})
        xi = difference(numbers(c["xi_camera_rig"]), se3_log(cam.T))
        for key, what in (("sigma_xi", "extrinsics"), ("sigma_xi_jackknife", "jackknife of extrinsics")):
            if key in c and name != next(iter(rig.cameras)):
                add(what, xi, c[key])
    for name, board in rig.boards.items():
        t = found.get("targets", {}).get(name)
        if t:
            add("board pose", difference(numbers(t["xi_target_own"]), se3_log(board.T)), t["sigma_xi"])
    if (out / "correlations.csv").exists():
        rows = read_table(out / "correlations.csv")
        names = [r["unknown"] for r in rows]
        # Extrinsics stand in sigma_xi of another chart: the joint test is of the parameters, as a block of all correlations.
        inside = [n for n in names if n in deviation and deviation[n][1] and np.isfinite(deviation[n][1])]
        C = np.array([[float(r[n]) for n in inside] for r in rows if r["unknown"] in inside])
        z = np.array([deviation[n][0] / deviation[n][1] for n in inside])
        values["joint"] = pair(np.linalg.solve(np.linalg.cholesky(C + 1e-12 * np.eye(len(C))), z), np.ones(len(z)))
    noise, stated = [], []
    for r in read_table(out / "residuals.csv") if (out / "residuals.csv").exists() else []:
        true, measured = rig.truth.get((r["camera"], r["frame"], int(r["marker"])), (None, None))
        if true is not None and r["used"] == "1":
            noise.extend(measured - true)
            stated.extend([float(r["noise_sigma"])] * 2)
    thin = slice(None, None, max(1, len(noise) // 200))  # some hundred of each run do
    if noise:
        values["point noise"] = pair(noise[thin], stated[thin])
        if len(rig.cameras) == 1:
            sigma = float(found["cameras"][next(iter(rig.cameras))]["residuals"]["noise"])
            values["noise"] = pair(noise[thin], np.full(len(noise[thin]), sigma))
    for name, board in rig.boards.items():
        path = out / (f"target_{name}.yaml" if len(rig.boards) > 1 else "target.yaml")
        if board.tolerance and path.exists():
            target = load(path)
            for number, sigma in target["sigma"].items():
                add("markers", numbers(target["markers"][number]) - board.points[int(number) % 100000], sigma)
    return values


# --- images without OpenCV ---

def write_png(path, image):
    """Grey image of 8 or 16 bits."""
    h, w = image.shape
    bits = 8 * image.itemsize
    rows = b"".join(b"\0" + row.astype(image.dtype.newbyteorder(">")).tobytes() for row in image)
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", w, h, bits, 0, 0, 0, 0)) +
                     chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))
