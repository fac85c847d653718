# SPDX-License-Identifier: Apache-2.0
# The extension module (python/src). Its arguments are checked by the package's Python files.
from os import PathLike
from typing import Any, Callable, Mapping, Sequence

from .arrays import FloatArray

__version__: str

# Number of threads, progress, message.
Caller = tuple[int, Callable[[str], object] | None, Callable[[str, bool], None]]
Size = tuple[int, int] | None

class SessionOptions:
    def __init__(self) -> None: ...
    out: str
    keep: bool
    exclude: Sequence[str]
    frames: int
    all: bool
    fresh: bool

class ImageArguments:
    images: Sequence[str]
    cameras: Sequence[str]
    target: str

class CalibrateRequest(SessionOptions):
    session: Session | None
    images: ImageArguments
    model: str
    jackknife: bool

class TryRequest(SessionOptions):
    models: Sequence[str]
    camera: str
    folds: int

class CheckRequest(SessionOptions):
    map: Sequence[str]
    distances: Sequence[float]

class SuggestRequest(SessionOptions):
    input: str
    model: str
    target: str
    size: Size
    angle: float
    count: int
    near: float
    far: float
    tilt: float
    goal: float

class LocateRequest:
    def __init__(self) -> None: ...
    map: str
    target: Target | None
    images: Sequence[str]
    camera: str
    white: Sequence[str]
    out: str

class WhiteRequest:
    def __init__(self) -> None: ...
    inputs: Sequence[str]
    model: str
    camera: str
    grid: str | None
    out: str
    def set_bayer(self, name: str) -> None: ...

class PlenopticInputs:
    white: Sequence[str]
    grid: str
    vignetting: str
    def set_bayer(self, name: str) -> None: ...

class FocusRequest:
    def __init__(self) -> None: ...
    raw: Sequence[str]
    camera: PlenopticInputs
    markers: str
    scale: float
    out: str

class ViewOptions:
    def __init__(self) -> None: ...
    size: Size
    fov: float | None
    balance: float | None

class ResampleSettings:
    interpolation: str
    keep_vignetting: bool
    def set_bayer(self, name: str) -> None: ...

class RectifyRequest:
    def __init__(self) -> None: ...
    left: str
    right: str
    cameras: Sequence[str]
    view: ViewOptions
    settings: ResampleSettings
    maps: bool
    preview: bool
    out: str

class UndistortRequest:
    def __init__(self) -> None: ...
    camera: str
    images: Sequence[str]
    view: ViewOptions
    settings: ResampleSettings
    out: str

class ExportRequest:
    def __init__(self) -> None: ...
    format: str
    cameras: Sequence[str]
    response: str
    out: str

Frames = Sequence[tuple[str, Any]]

Points = Sequence[tuple[str, Sequence[int], FloatArray]]

def session_of_arrays(
    target: str, cameras: Sequence[tuple[str, str, Sequence[int], Frames, Points]]
) -> Session: ...
def calibrate(request: CalibrateRequest, report: bool, caller: Caller) -> tuple[Record, str]: ...
def detect_session(
    session: Session, options: SessionOptions, caller: Caller
) -> dict[str, dict[str, Any]]: ...
def try_models(session: Session, request: TryRequest, caller: Caller) -> str: ...
def check(calibration: Record, session: Session, request: CheckRequest, caller: Caller) -> str: ...
def compare(
    a: Record,
    b: Record,
    map: Sequence[str],
    distances: Sequence[float],
    folder: str,
    caller: Caller,
) -> str: ...
def suggest(
    request: SuggestRequest, picture: str, caller: Caller, *source: Session | Record
) -> str: ...
def weigh(calibration: str, pictures: Mapping[str, str], caller: Caller) -> str: ...
def locate(
    calibration: Record, request: LocateRequest, images: Frames, caller: Caller
) -> list[dict[str, Any]]: ...
def simulate(specification: str, out: str, points: bool, caller: Caller) -> str: ...
def white(
    request: WhiteRequest, caller: Caller
) -> list[tuple[str, Any, dict[str, Any] | None, dict[str, float] | None, str]]: ...
def focus(request: FocusRequest, caller: Caller) -> list[tuple[str, Any, Any, Any, str]]: ...
def rectify(
    calibration: Record, request: RectifyRequest, caller: Caller
) -> tuple[list[Camera], float, list[int], dict[str, float]]: ...
def undistort(
    calibration: Record, request: UndistortRequest, caller: Caller
) -> tuple[Camera, int]: ...
def export(
    calibration: Record, request: ExportRequest, caller: Caller
) -> list[PathLike[str]]: ...
def check_model(name: str) -> str: ...
def run_as_program(arguments: Sequence[str]) -> int: ...
def load_plugin(path: str) -> None: ...
def models() -> list[str]: ...
def model_info(name: str) -> dict[str, Any]: ...
def register_model(
    object: object,
    name: str,
    source: str,
    params: Sequence[tuple[str, str, float, float, float, float | None, int, float]],
    example: Sequence[float],
    example_size: Sequence[int],
    has_jacobian: bool,
) -> None: ...

class Camera:
    @staticmethod
    def make(
        name: str,
        model: str,
        image_size: Sequence[int],
        params: Sequence[float],
        config: Sequence[float],
        T_camera_rig: FloatArray,
        covariance: FloatArray | None,
    ) -> Camera: ...
    @property
    def name(self) -> str: ...
    @property
    def image_size(self) -> list[int]: ...
    @property
    def at_bound(self) -> list[str]: ...
    @property
    def model(self) -> str: ...
    @property
    def central(self) -> bool: ...
    @property
    def plenoptic(self) -> bool: ...
    @property
    def measured(self) -> list[str]: ...
    @property
    def context(self) -> list[str]: ...
    @property
    def names_and_units(self) -> list[tuple[str, str]]: ...
    @property
    def params(self) -> FloatArray: ...
    @property
    def config(self) -> FloatArray: ...
    @property
    def covariance(self) -> FloatArray: ...
    @property
    def T_camera_rig(self) -> FloatArray: ...
    @property
    def fit(self) -> dict[str, float]: ...
    def project(self, points: FloatArray, context: FloatArray | None) -> FloatArray: ...
    def jacobian(
        self, points: FloatArray, context: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]: ...
    def uncertainty(self, points: FloatArray, context: FloatArray | None) -> FloatArray: ...
    def rays(
        self, pixels: FloatArray, context: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]: ...
    def compare(self, other: Camera, distances: Sequence[float]) -> dict[str, Any]: ...
    def convert(self, model: str) -> tuple[Camera, float, float, int]: ...
    def image_sigma(self, distances: Sequence[float]) -> float: ...
    def yaml(self) -> str: ...

class Record:
    @staticmethod
    def load(path: str) -> Record: ...
    @staticmethod
    def of_cameras(cameras: Sequence[Camera]) -> Record: ...
    def yaml(self) -> str: ...
    def save(self, path: str) -> None: ...
    def report(self) -> str: ...
    def poses(self) -> dict[str, Any]: ...
    def markers(self) -> dict[str, Any]: ...
    def residuals(self, camera: int) -> dict[str, Any]: ...
    def residual_picture(self, camera: int) -> bytes: ...
    def verdict(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def cameras(self) -> list[Camera]: ...
    @property
    def correlations(self) -> tuple[list[str], FloatArray]: ...
    @property
    def left_out(self) -> list[str]: ...
    @property
    def provenance(self) -> dict[str, str]: ...

class Target:
    @staticmethod
    def load(path: str) -> Target: ...
    @staticmethod
    def parse(word: str) -> Target: ...
    def positions(self) -> dict[str, Any]: ...
    @property
    def tolerance(self) -> float | None: ...
    @property
    def yaml(self) -> str: ...

class Session:
    @staticmethod
    def load(path: str) -> Session: ...
    @property
    def path(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def has_scene(self) -> bool: ...
    def cameras(self) -> list[dict[str, Any]]: ...
    def target(self) -> Target: ...

Detections = tuple[dict[str, Any], str, list[str]]

def detect_array(image: Any, target: Target) -> Detections: ...
def detect_file(path: str, target: Target) -> Detections: ...
def detections_table(points: Points) -> str: ...

Maps = tuple[Any, Any, Camera]

def undistort_maps(camera: Camera, options: ViewOptions, threads: int) -> Maps: ...
def rectify_maps(
    first: Camera, second: Camera, options: ViewOptions, threads: int
) -> tuple[Maps, Maps, float]: ...
