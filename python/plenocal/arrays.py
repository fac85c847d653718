# SPDX-License-Identifier: Apache-2.0
"""Converts arguments to arrays of the right type and shape, and tables to structured arrays."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Iterable, Mapping, Sequence, Union

from .errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    FloatArray = npt.NDArray[np.float64]
    Table = npt.NDArray[np.void]

PathLike = Union[str, "os.PathLike[str]"]


def floats(value: Any, name: str, columns: int | None = None) -> FloatArray:
    """`value` as rows (N, `columns`) of 64-bit numbers, or in its own shape; copied only if necessary.

    Raises `InputError` for another shape and for values that are not real numbers.
    """
    import numpy as np

    expected = "numbers" if columns is None else f"an array of shape (N, {columns})"
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}: expected {expected}, found rows of different lengths") from error
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name}: expected {expected} of real numbers, found {array.dtype}")
    if columns is not None and (array.ndim != 2 or array.shape[1] != columns):
        raise InputError(f"{name}: expected {expected}, found shape {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float64)


def transform(value: Any, name: str) -> FloatArray:
    """A rigid transform as a matrix of shape (4, 4); raises `InputError` for any other matrix."""
    import numpy as np

    matrix = floats(value, name, 4)
    rotation = matrix[:3, :3]
    tolerance = 1e-6  # for matrices written with few digits
    if (
        matrix.shape != (4, 4)
        or not np.isfinite(matrix).all()
        or not np.allclose(matrix[3], [0, 0, 0, 1])
        or not np.allclose(rotation @ rotation.T, np.eye(3), atol=tolerance)
        or np.linalg.det(rotation) < 0
    ):
        raise InputError(f"{name}: expected a 4 x 4 matrix of a rotation and a translation")
    return matrix


def pixels(size: Sequence[int], name: str, most: int = 2**31) -> tuple[int, int]:
    """Width and height, each below `most`; raises `InputError`."""
    values = [int(v) for v in size]
    if len(values) != 2 or not all(0 < v < most for v in values):
        raise InputError(f"{name}: expected width and height in pixels, found {size}")
    return values[0], values[1]


def table(columns: Mapping[str, Any]) -> Table:
    """A structured array of columns of equal length."""
    import numpy as np

    arrays = {name: np.asarray(column) for name, column in columns.items()}
    for name, array in arrays.items():
        if array.size == 0 and isinstance(columns[name], list):
            arrays[name] = np.empty(0, dtype="U1")
    count = len(next(iter(arrays.values())))
    records = np.empty(
        count, dtype=[(name, array.dtype, array.shape[1:]) for name, array in arrays.items()]
    )
    for name, array in arrays.items():
        records[name] = array
    return records


def images_in_memory(images: Any) -> list[tuple[str, list[tuple[str, Any]]]]:
    """Cameras with their frames if `images` holds arrays; empty if it holds paths. A single camera is named "cam".

    Raises `InputError` for arrays that are no images.
    """
    cameras = images if isinstance(images, Mapping) else {"cam": images}
    found = []
    for name, frames in cameras.items():
        if isinstance(frames, (str, os.PathLike)):
            return []
        if getattr(frames, "ndim", 0) == 2 or getattr(frames, "shape", ())[2:] == (3,):
            frames = [frames]
        named = list(frames.items() if isinstance(frames, Mapping) else _numbered(frames))
        if any(isinstance(frame, (str, os.PathLike)) for _, frame in named):
            return []
        found.append((str(name), [(str(frame), _pixels(pixels, f"{name}: frame {frame}")) for frame, pixels in named]))
    return found


def _numbered(frames: Iterable[Any]) -> list[tuple[str, Any]]:
    return [(f"{i:04}", frame) for i, frame in enumerate(frames)]


def _pixels(pixels: Any, where: str) -> Any:
    """An array whose rows are contiguous in memory, copied only if necessary."""
    import numpy as np

    array = np.asarray(pixels)
    shape_fits = array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)
    if not shape_fits or array.size == 0 or array.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{where}: expected (H, W) or (H, W, 3), uint8 or uint16, found {array.dtype} of shape {array.shape}"
        )
    pixel = array.itemsize if array.ndim == 2 else 3 * array.itemsize
    is_row = array.strides[1] == pixel and array.strides[-1] == array.itemsize
    return array if is_row and array.strides[0] > 0 else np.ascontiguousarray(array)
