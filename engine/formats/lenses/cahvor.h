// SPDX-License-Identifier: Apache-2.0
//
// CAHVOR and CAHVORE, JPL's camera models: a pinhole camera A, H, V with a radial lens about
// another axis O.
//
// Source: Gennery, Generalized camera calibration including fish-eye lenses (IJCV 68, 2006); mrcal.
// A point p, seen from C, with w = p . O and tau = |p - w O|^2 / w^2 is imaged at (H p', V p') / (A
// p'), p' = p + (R_0 + R_1 tau + R_2 tau^2) (p - w O). In a frame with the axis z along O this is a
// radial lens before a tilted sensor: `pinhole-radial3+tilt+skew`.
//
// CAHVORE has the lens of `linearity` L, chi = tan(L theta) / L (L > 0), theta (L = 0), sin(L
// theta) / L (L < 0), with R_0 + R_1 chi^2 + R_2 chi^4, and a centre that moves along O, which is
// the part `pupil` with e = E, in the unit of C. Lenses of a linearity without a model of its own
// are made of a formula.
#pragma once

#include <optional>
#include <string>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// In the frame of the rig.
struct Cahvor {
  Eigen::Vector3d C{0, 0, 0};
  Eigen::Matrix3d HVA = Eigen::Matrix3d::Identity();  ///< rows; (0, 0) is the first pixel's centre
  Eigen::Vector3d O{0, 0, 1}, R{0, 0, 0}, E{0, 0, 0};
  std::optional<double> linearity = {};  ///< of CAHVORE
};

/// Name of the lens of a linearity, which is made of a formula where there is none:
/// "linearity-0p35", "linearity-m0p713". Throws as `FromCahvor`.
std::string LensOfLinearity(double linearity, const std::string& where);

/// Throws `Error` of kind kInput, `where` before the message.
CalibratedCamera FromCahvor(const Cahvor& cahvor, ImageSize image_size, const std::string& where);

/// With H and V that are orthogonal but for A; CAHVOR where it can be. Throws `Error` of kind kJob
/// for another model, and where there is none.
Cahvor ToCahvor(const CalibratedCamera& camera);

}  // namespace plenocal
