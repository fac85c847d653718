// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/matlab_intrinsics.h"

#include "engine/formats/lens_form.h"

namespace plenocal {
namespace {

const LensTable& MatlabLenses() {
  static const LensTable kTable{
      .tool = "matlab",
      .forms = {OpenCvLenses().forms.begin(), OpenCvLenses().forms.begin() + 4},
      .first_pixel = 1};
  return kTable;
}

}  // namespace

MatlabIntrinsics ToMatlab(const CalibratedCamera& camera) {
  Lens lens = ToLens(camera, MatlabLenses());
  lens.coefficients.resize(5);
  const std::vector<double>& k = lens.coefficients;
  return {{lens.f_x, lens.f_y},
          {lens.c_x, lens.c_y},
          {static_cast<double>(camera.image_size[1]), static_cast<double>(camera.image_size[0])},
          {k[0], k[1], k[4]},
          {k[2], k[3]}};
}

CalibratedCamera FromMatlab(const MatlabIntrinsics& m, const std::string& where) {
  std::vector<double> radial = m.radial_distortion;
  radial.resize(3);
  return FromLens(
      {"radtan",
       m.focal_length[0],
       m.focal_length[1],
       m.principal_point[0],
       m.principal_point[1],
       {radial[0], radial[1], m.tangential_distortion[0], m.tangential_distortion[1], radial[2]}},
      {static_cast<int>(m.image_size[1]), static_cast<int>(m.image_size[0])},
      MatlabLenses(),
      where);
}

}  // namespace plenocal
