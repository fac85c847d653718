# SPDX-License-Identifier: Apache-2.0
"""Images of textured walls by a stereo pair on a loop, in numpy and without the program, for bench/scene --images."""
import numpy as np

import common
from accuracy.geometry import exponential, quaternion

SIZE = (640, 480)
RIGHT_XI = np.array([-0.1, 0.001, -0.002, 0.005, -0.02, 0.01])
PARAMETERS = {"left": [520, 521, 318, 243, -0.2, 0.06, -0.01], "right": [515, 514, 323, 236, -0.19, 0.05, -0.008]}
NAMES = ["f_x", "f_y", "c_x", "c_y", "A_0", "A_1", "A_2"]
SIGMA, SIGMA_XI = [0.15] * 4 + [2e-4] * 3, [20e-6] * 3 + [50e-6] * 3
BLUR = 0.6  # px, of lens and pixel
NOISE = 3  # grey values at 255, by photons
FRAMES = 25  # of a segment
PAD = 2  # px about the image
TEXEL = 0.002  # m
# Corner, edge along u, edge along v, m; blur of the texture, texels.
WALLS = [
    ([-4, -2.5, 4.6], [8, 0, -0.8], [0, 5, 0], 2.5),
    ([-2.6, -2.5, 1.0], [0.9, 0, 5], [0, 5, 0], 4),
    ([-4, 1.3, 0.6], [8, 0, 0], [0, 0.4, 4.6], 2),
    ([0.35, -0.6, 2.2], [0.9, 0, 0.25], [0, 1.0, 0.1], 1.5),
    ([-1.1, -0.2, 2.9], [0.8, 0.1, -0.2], [-0.05, 0.9, 0], 3),
]


def make_texture(rng, width, height, blur):
    """Grey values: noise of several octaves with edges."""
    rows, columns = 2 * int(np.ceil(height / TEXEL / 2)), 2 * int(np.ceil(width / TEXEL / 2))
    spectrum = np.fft.rfft2(rng.standard_normal((rows, columns)).astype(np.float32))
    f = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None])  # 1 / texel
    waves = np.fft.irfft2(spectrum * np.exp(-2 * np.pi**2 * blur**2 * f**2) / np.maximum(f, 1 / 250), s=(rows, columns))
    waves /= waves.std()
    return (128 + 55 * np.tanh(1.5 * waves) + 12 * np.clip(waves, -3, 3)).astype(np.float32)


def directions(parameters):
    """x / z and y / z of the samples, two by two a pixel."""
    f_x, f_y, c_x, c_y, *A = parameters
    u, v = ((np.arange(2 * (size + 2 * PAD)) + 0.5) / 2 - 0.5 - PAD for size in SIZE)
    X, Y = np.meshgrid((u - c_x) / f_x, (v - c_y) / f_y)
    x, y = X, Y
    for _ in range(30):
        r2 = x * x + y * y
        s = 1 + r2 * (A[0] + r2 * (A[1] + r2 * A[2]))
        x, y = X / s, Y / s
    return x.astype(np.float32), y.astype(np.float32)


def render(textures, T_camera_world, rays):
    """The samples: the nearest wall's texture."""
    R, t = T_camera_world[:3, :3], T_camera_world[:3, 3]
    value, nearest = np.zeros_like(rays[0]), np.zeros_like(rays[0])  # nearest: 1 / depth
    for (corner, a, b, _), texture in zip(WALLS, textures):
        # depth (x, y, 1) = corner + u a + v b
        M = np.linalg.inv(np.stack([R @ a, R @ b, R @ corner + t], axis=1)).astype(np.float32)
        u, v, w = (M[i, 0] * rays[0] + M[i, 1] * rays[1] + M[i, 2] for i in range(3))
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = u / w, v / w
        see = np.flatnonzero((w > nearest) & (u >= 0) & (u < 1) & (v >= 0) & (v < 1))
        rows, columns = texture.shape
        u, v = u.flat[see] * np.float32(columns - 1.001), v.flat[see] * np.float32(rows - 1.001)
        i, j = u.astype(np.int32), v.astype(np.int32)
        u, v, at, grey = u - i, v - j, j * columns + i, texture.ravel()
        upper, lower = (grey[k] * (1 - u) + grey[k + 1] * u for k in (at, at + columns))
        value.flat[see] = upper * (1 - v) + lower * v
        nearest.flat[see] = w.flat[see]
    return value


def expose(rng, samples):
    """Pixels: the samples under a Gaussian, with noise."""
    steps = np.arange(-3, 5)
    weights = np.exp(-(steps / 2 - 0.25)**2 / 2 / BLUR**2).astype(np.float32)
    weights /= weights.sum()
    first = 2 * PAD + steps
    rows = sum(w * samples[k:k + 2 * SIZE[1]:2] for k, w in zip(first, weights))
    clean = sum(w * rows[:, k:k + 2 * SIZE[0]:2] for k, w in zip(first, weights))
    noisy = clean + NOISE * np.sqrt(np.maximum(clean, 1) / 255) * rng.standard_normal(clean.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def path(rng, offset):
    """T_world_rig of a segment."""
    phases = rng.uniform(0, 2 * np.pi, 6)
    sway, turn = np.array([0.3, 0.12, 0.15]), np.array([0.03, 0.05, 0.04])
    s = 2 * np.pi * np.arange(FRAMES)[:, None] / FRAMES
    p, w = sway * np.sin([1, 2, 1.3] * s + phases[:3]), turn * np.sin([1.7, 1, 1.2] * s + phases[3:])
    return [exponential(offset + xi) for xi in np.hstack([p, w])]


def write_recording(folder, seed):
    """Recording, calibration with errors of its own sigmas, truth/segments_left.txt."""
    rng = np.random.default_rng(seed)
    textures = [make_texture(rng, np.linalg.norm(a), np.linalg.norm(b), blur) for _, a, b, blur in WALLS]
    offset = np.r_[rng.uniform(-0.2, 0.2, 3), rng.uniform(-0.05, 0.05, 3)]
    T_world_rig = path(rng, np.zeros(6)) + path(rng, offset)
    times = np.r_[np.arange(FRAMES) * 0.1, 60 + np.arange(FRAMES) * 0.1]
    (folder / "truth").mkdir(parents=True)
    np.savetxt(folder / "times.txt", times, fmt="%.6f")
    np.savetxt(folder / "truth/segments_left.txt",
               [[time, *T[:3, 3], *quaternion(T[:3, :3])] for time, T in zip(times, T_world_rig)], fmt="%.12g")
    cameras = {}
    for name, xi in {"left": np.zeros(6), "right": RIGHT_XI}.items():
        (folder / name).mkdir()
        held = not xi.any()
        T_camera_rig, rays = np.eye(4) if held else exponential(xi), directions(PARAMETERS[name])
        for k, T in enumerate(T_world_rig):
            pixels = expose(rng, render(textures, T_camera_rig @ np.linalg.inv(T), rays))
            (folder / name / f"{k:04d}.pgm").write_bytes(b"P5\n%d %d\n255\n" % SIZE + pixels.tobytes())
        given = PARAMETERS[name] + SIGMA * rng.standard_normal(7)
        xi = xi if held else xi + SIGMA_XI * rng.standard_normal(6)
        cameras[name] = {
            "model": "pinhole-radial3", "image_size": list(SIZE), "parameters": dict(zip(NAMES, given.tolist())),
            "sigma": dict(zip(NAMES, SIGMA)), "xi_camera_rig": xi.tolist(), "sigma_xi": [0.0] * 6 if held else SIGMA_XI,
            "T_camera_rig": (np.eye(4) if held else exponential(xi)).tolist()}
    common.save(folder / "calibration.yaml", {"cameras": cameras})
    common.save(folder / "recording.yaml", {
        "calibration": "calibration.yaml", "pairing": {"by": "name"},
        "cameras": {name: {"images": name, "times": "times.txt"} for name in cameras}})
