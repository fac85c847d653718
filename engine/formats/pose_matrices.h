// SPDX-License-Identifier: Apache-2.0
//
// Rotations and extrinsics as other tools write them.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "calib/files/calibration_record.h"
#include "calib/io/yaml.h"

namespace plenocal {

/// R row by row.
std::array<double, 9> RowMajor(const Eigen::Matrix3d& R);
/// The 4 x 4 matrix of a transform row by row.
std::array<double, 16> RowMajor(const RigidTransform& T);
/// Maps the frame of the first camera of a pair to that of the second.
RigidTransform SecondFromFirst(const std::vector<CalibratedCamera>& pair);
/// The transform with `R` row by row.
RigidTransform FromRowMajor(const std::vector<double>& R, const std::vector<double>& t);

/// The first three rows (R t) of a transform's 4 x 4 matrix.
std::array<std::array<double, 4>, 3> Rows(const RigidTransform& T);

/// T_camera_rig of a camera of a rectified pair, one beside or above the other: `R` rotates the
/// camera into the rectified orientation, in which the 3 x 4 matrix `P` projects points of the
/// first camera's frame. Both row by row. Fails at `node` when R is not a rotation.
RigidTransform FromRectified(const std::vector<double>& R,
                             const std::vector<double>& P,
                             const YamlNode& node);

/// An image of a frame, as tools for many images have it.
struct ViewImage {
  size_t camera = 0;  ///< place among the cameras asked for
  std::string file;   ///< `<frame>.png`, of several cameras `<camera>/<frame>.png`
  RigidTransform T_camera_target;
};
/// The images of a calibration's frames by some of its cameras; of a rig those with used
/// observations.
std::vector<ViewImage> ViewImages(const CalibrationRecord& calibration,
                                  const std::vector<size_t>& cameras);

/// One image a camera, `<camera>.png`, in the frame of the rig.
std::vector<ViewImage> RigImages(const std::vector<CalibratedCamera>& cameras);
/// The inverse: names of cameras that have one image, and the extrinsics when all have one, each
/// with a pose (`posed`).
void TakeRigImages(const std::vector<ViewImage>& images,
                   bool posed,
                   std::vector<CalibratedCamera>* cameras);
/// The pose of a camera with its centre at `centre`.
RigidTransform CameraAt(const Eigen::Matrix3d& R, const std::vector<double>& centre);

/// Makes the frame of the first camera that of the rig: all T_camera_rig become relative to it.
void MakeFirstMaster(std::vector<CalibratedCamera>* cameras);

}  // namespace plenocal
