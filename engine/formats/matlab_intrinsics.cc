// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/matlab_intrinsics.h"

#include <utility>

#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"

namespace plenocal {
namespace {

std::span<const LensForm> MatlabLenses() { return OpenCvLenses().first(4); }

}  // namespace

MatlabIntrinsics ToMatlab(const CalibratedCamera& camera) {
  Lens lens = ToLens(camera, MatlabLenses(), "matlab");
  lens.coefficients.resize(5);
  const std::vector<double>& k = lens.coefficients;
  return {{lens.f_x, lens.f_y},
          {lens.c_x + 1, lens.c_y + 1},
          {static_cast<double>(camera.image_size[1]), static_cast<double>(camera.image_size[0])},
          {k[0], k[1], k[4]},
          {k[2], k[3]}};
}

CalibratedCamera FromMatlab(const MatlabIntrinsics& m, const std::string& where) {
  std::vector<double> radial = m.radial_distortion;
  radial.resize(3);
  const auto centre = [](double value) {
    return Inverted(value, value - 1, [](double x) { return x + 1; });
  };
  return FromLens(
      {"radtan",
       m.focal_length[0],
       m.focal_length[1],
       centre(m.principal_point[0]),
       centre(m.principal_point[1]),
       {radial[0], radial[1], m.tangential_distortion[0], m.tangential_distortion[1], radial[2]}},
      {static_cast<int>(m.image_size[1]), static_cast<int>(m.image_size[0])},
      MatlabLenses(),
      where);
}

}  // namespace plenocal
