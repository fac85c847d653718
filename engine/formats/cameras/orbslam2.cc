// SPDX-License-Identifier: Apache-2.0
//
// Camera part of ORB-SLAM2's settings.
#include <fmt/format.h>

#include <array>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/opencv_storage.h"
#include "engine/formats/orbslam_camera.h"
#include "engine/formats/pose_matrices.h"
#include "engine/resample/rectify.h"

namespace plenocal {
namespace {

/// One camera, or a pair with what rectifies it; Camera.* are then the rectified views' and b times
/// f is Camera.bf.
std::string WriteOrbSlam2(const std::vector<CalibratedCamera>& cameras) {
  const Lens first = ToLens(cameras[0], OrbSlam2Lenses());
  if (cameras.size() == 1) {
    return kOpenCvHead + OrbSlamCamera("Camera", first) + OrbSlamImages(cameras[0]);
  }
  const RectifiedPair pair = Rectify(cameras[0], cameras[1], {});
  if (pair.baseline < 0) {
    throw JobError("orbslam2: takes the left camera first; give --camera {} {}",
                   cameras[1].name,
                   cameras[0].name);
  }
  const std::vector<double>& p = pair.views[0].params;
  std::string text =
      kOpenCvHead + OrbSlamCamera("Camera", {"PinHole", p[0], p[1], p[2], p[3], {0, 0, 0, 0, 0}}) +
      OrbSlamImages(pair.views[0]) +
      fmt::format("# baseline times fx\nCamera.bf: {}\n\n", RealText(pair.baseline * p[0]));
  for (size_t c = 0; c < 2; ++c) {
    const std::string side = c == 0 ? "LEFT" : "RIGHT";
    const Lens lens = ToLens(cameras[c], OrbSlam2Lenses());
    text += fmt::format("{0}.height: {1}\n{0}.width: {2}\n",
                        side,
                        cameras[c].image_size[1],
                        cameras[c].image_size[0]);
    text += Coefficients(side + ".D", lens) + CameraMatrix(side + ".K", lens) +
            OpenCvMatrix(side + ".R", 3, 3, 'd', RowMajor(pair.R_view_camera[c])) +
            OpenCvMatrix(side + ".P", 3, 4, 'd', pair.ProjectionMatrix(c));
  }
  return text;
}

std::vector<CalibratedCamera> ReadOrbSlam2(const CameraSource& source) {
  const YamlNode root = ReadStorage(source.path);
  if (!root.Has("LEFT.K")) {
    // ORB-SLAM3's files without File.version have these keys too.
    const std::string type =
        root.Has("Camera.type") ? root.At("Camera.type").AsString() : "PinHole";
    return {FromLens(ReadLensEntries(root, type, OrbSlam3Lenses(), "Camera."),
                     ReadOrbSlamSize(root, source),
                     OrbSlam3Lenses(),
                     source.path.string())};
  }
  std::vector<CalibratedCamera> cameras;
  for (const std::string side : {"LEFT", "RIGHT"}) {
    Lens lens = LensOf(root.At(side + ".K"), root.At(side + ".D"), OpenCvDistortion::kRadtan);
    lens.name = "PinHole";
    cameras.push_back(
        FromLens(lens,
                 {root.At(side + ".width").AsInteger(), root.At(side + ".height").AsInteger()},
                 OrbSlam2Lenses(),
                 source.path.string()));
    const YamlNode R = root.At(side + ".R");
    cameras.back().T_camera_rig =
        FromRectified(MatrixData(R, 9), MatrixData(root.At(side + ".P"), 12), R);
    cameras.back().name = side == "LEFT" ? "left" : "right";
  }
  return cameras;
}

}  // namespace

CameraFormat Orbslam2Format() {
  return {.name = "orbslam2",
          .file = "settings.yaml",
          .most_cameras = 2,
          .holds_extrinsics = true,
          .write = WriteOrbSlam2,
          .read = ReadOrbSlam2};
}

}  // namespace plenocal
