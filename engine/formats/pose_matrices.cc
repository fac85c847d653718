// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/pose_matrices.h"

#include <algorithm>
#include <filesystem>

#include "calib/files/checks/transform_keys.h"

namespace plenocal {
std::array<double, 9> RowMajor(const Eigen::Matrix3d& R) {
  std::array<double, 9> values{};
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(values.data()) = R;
  return values;
}

std::array<double, 16> RowMajor(const RigidTransform& T) {
  const auto rows = Rows(T);
  std::array<double, 16> values{};
  for (size_t i = 0; i < 12; ++i) values[i] = rows[i / 4][i % 4];
  values[15] = 1;
  return values;
}

RigidTransform SecondFromFirst(const std::vector<CalibratedCamera>& pair) {
  return pair[1].T_camera_rig * pair[0].T_camera_rig.Inverse();
}

std::array<std::array<double, 4>, 3> Rows(const RigidTransform& T) {
  std::array<std::array<double, 4>, 3> rows{};
  for (int r = 0; r < 3; ++r) {
    rows[static_cast<size_t>(r)] = {T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]};
  }
  return rows;
}

RigidTransform FromRectified(const std::vector<double>& R,
                             const std::vector<double>& P,
                             const YamlNode& node) {
  Eigen::Matrix3d rotation =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data());
  if (!MakeRotation(&rotation)) node.Fail("is no rotation");
  const auto shift = [](double moved, double f) { return f != 0 ? moved / f : 0; };
  return {rotation.transpose(),
          rotation.transpose() * Eigen::Vector3d(shift(P[3], P[0]), shift(P[7], P[5]), 0)};
}

RigidTransform FromRowMajor(const std::vector<double>& R, const std::vector<double>& t) {
  return {Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data()),
          Eigen::Map<const Eigen::Vector3d>(t.data())};
}

std::vector<ViewImage> ViewImages(const CalibrationRecord& calibration,
                                  const std::vector<size_t>& cameras) {
  const bool is_rig = calibration.cameras.size() > 1;
  std::vector<ViewImage> images;
  for (size_t c = 0; c < cameras.size(); ++c) {
    const CalibratedCamera& camera = calibration.cameras[cameras[c]];
    for (size_t f = 0; f < calibration.frames.size(); ++f) {
      const int frame = static_cast<int>(f);
      if (is_rig && !camera.view_poses.contains(frame)) continue;
      images.push_back(
          {c,
           (is_rig ? camera.name + "/" : std::string()) + calibration.frames[f].name + ".png",
           calibration.CameraFromTarget(cameras[c], frame)});
    }
  }
  return images;
}

std::vector<ViewImage> RigImages(const std::vector<CalibratedCamera>& cameras) {
  std::vector<ViewImage> images;
  for (size_t c = 0; c < cameras.size(); ++c) {
    images.push_back({c, cameras[c].name + ".png", cameras[c].T_camera_rig});
  }
  return images;
}

void TakeRigImages(const std::vector<ViewImage>& images,
                   bool posed,
                   std::vector<CalibratedCamera>* cameras) {
  std::vector<const ViewImage*> only(cameras->size());
  std::vector<int> counts(cameras->size());
  for (const ViewImage& image : images) {
    only[image.camera] = &image;
    ++counts[image.camera];
  }
  const bool is_rig = posed && std::ranges::all_of(counts, [](int count) { return count == 1; });
  for (size_t c = 0; c < only.size(); ++c) {
    if (counts[c] != 1) continue;
    (*cameras)[c].name = std::filesystem::path(only[c]->file).stem().string();
    if (is_rig) (*cameras)[c].T_camera_rig = only[c]->T_camera_target;
  }
}

RigidTransform CameraAt(const Eigen::Matrix3d& R, const std::vector<double>& centre) {
  return {R, -(R * Eigen::Map<const Eigen::Vector3d>(centre.data()))};
}

void MakeFirstMaster(std::vector<CalibratedCamera>* cameras) {
  const RigidTransform T_rig_first = cameras->front().T_camera_rig.Inverse();
  for (CalibratedCamera& camera : *cameras) {
    camera.T_camera_rig =
        &camera == &cameras->front() ? RigidTransform() : camera.T_camera_rig * T_rig_first;
  }
}

}  // namespace plenocal
