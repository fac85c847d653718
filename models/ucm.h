// SPDX-License-Identifier: Apache-2.0
//
// Unified camera model: rays are projected onto a sphere, then by a pinhole.
//
// Source: Geyer and Daniilidis, A unifying theory for central panoramic systems (ECCV 2000), in the
// form of Usenko, Demmel and Cremers, The double sphere camera model (3DV 2018); the xi and gamma
// of Mei and Rives (ICRA 2007, OpenCV's omnidir, Kalibr's omni) are xi = alpha / (1 - alpha),
// gamma = f / (1 - alpha). It is the enhanced model (models/eucm.h) with beta = 1:
//
//   h = alpha sqrt(x_C^2 + y_C^2 + z_C^2) + (1 - alpha) z_C
//   x_Id = f_x x_C / h + c_x, y_Id = f_y y_C / h + c_y               (pixels)
#pragma once

#include "models/eucm.h"

namespace plenocal {

struct Ucm : LensModel<Ucm> {
  static constexpr std::string_view kName = "ucm";
  static constexpr Usage kUsage = Usage::kSome;
  static constexpr std::string_view kSource =
      "Geyer and Daniilidis, ECCV 2000; Usenko et al., 3DV 2018";
  static constexpr auto kParams = WithIntrinsics<1>({Eucm::kParams[4]});
  static constexpr std::array kExample{240.0, 242.0, 322.0, 243.0, 0.57};
  static constexpr std::array kStart{0.5};

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    const T alpha_beta[2] = {k[0], T(1.0)};
    return Eucm::Map(alpha_beta, p, m);
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double alpha_beta[2] = {k[0], 1};
    return Eucm::Unmap(alpha_beta, m);
  }
};

}  // namespace plenocal
