// SPDX-License-Identifier: Apache-2.0
//
// Camera part of ORB-SLAM3's settings. Stereo.T_c1_c2 maps camera 2 to camera 1 and must be of
// 32-bit floats; lengths in pixels must be reals, sizes integers, or it stops.
#include <fmt/format.h>

#include <array>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/opencv_storage.h"
#include "engine/formats/orbslam_camera.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

std::string WriteOrbSlam3(const std::vector<CalibratedCamera>& cameras) {
  const Lens first = ToLens(cameras[0], OrbSlam3Lenses());
  std::string text =
      kOpenCvHead + fmt::format("File.version: \"1.0\"\nCamera.type: \"{}\"\n\n", first.name);
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Lens lens = ToLens(cameras[i], OrbSlam3Lenses());
    if (lens.name != first.name || cameras[i].image_size != cameras[0].image_size) {
      throw JobError(
          "orbslam3: both cameras must have one kind of lens and images of one size; "
          "export one with --camera");
    }
    text += OrbSlamCamera(fmt::format("Camera{}", i + 1), lens);
  }
  text += OrbSlamImages(cameras[0]);
  if (cameras.size() < 2) return text;
  const RigidTransform T_1_2 = cameras[0].T_camera_rig * cameras[1].T_camera_rig.Inverse();
  return text + "\n# maps camera 2 to camera 1\n" +
         OpenCvMatrix("Stereo.T_c1_c2", 4, 4, 'f', RowMajor(T_1_2));
}

std::vector<CalibratedCamera> ReadOrbSlam3(const CameraSource& source) {
  const YamlNode root = ReadStorage(source.path);
  const std::string type = root.At("Camera.type").AsString();
  const ImageSize size = ReadOrbSlamSize(root, source);
  std::vector<CalibratedCamera> cameras;
  for (const std::string prefix : {"Camera1", "Camera2"}) {
    if (!cameras.empty() && !root.Has(prefix + ".fx")) break;
    cameras.push_back(FromLens(ReadLensEntries(root, type, OrbSlam3Lenses(), prefix + "."),
                               size,
                               OrbSlam3Lenses(),
                               source.path.string()));
    cameras.back().name = prefix == "Camera1" ? "camera1" : "camera2";
  }
  if (cameras.size() == 2) {
    const std::vector<double> T = MatrixData(root.At("Stereo.T_c1_c2"), 16);
    cameras[1].T_camera_rig =
        FromRowMajor({T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]}, {T[3], T[7], T[11]})
            .Inverse();
  }
  return cameras;
}

}  // namespace

CameraFormat Orbslam3Format() {
  return {.name = "orbslam3",
          .file = "settings.yaml",
          .most_cameras = 2,
          .holds_extrinsics = true,
          .write = WriteOrbSlam3,
          .read = ReadOrbSlam3};
}

}  // namespace plenocal
