// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/matlab_intrinsics.h"

#include <cmath>

#include "calib/base/format_error.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/lenses/stretched_fisheye.h"

namespace plenocal {
namespace {

constexpr double kMatlabPixel = 1;  // coordinate of the centre of the first pixel

/// The last coefficient is the skew by f_x.
const LensTable& MatlabLenses() {
  static const LensTable kTable{
      .tool = "matlab",
      .forms = {{"pinhole", "radtan", "0 0 0 0 0 0"},
                {"pinhole-radial3", "radtan", "A_0 A_1 0 0 A_2 0"},
                {"pinhole-radtan4", "radtan", "k_1 k_2 p_1 p_2 0 0"},
                {"pinhole-radtan", "radtan", "k_1 k_2 p_1 p_2 k_3 0"},
                {"pinhole+skew", "radtan", "0 0 0 0 0 alpha_s"},
                {"pinhole-radial3+skew", "radtan", "A_0 A_1 0 0 A_2 alpha_s"},
                {"pinhole-radtan4+skew", "radtan", "k_1 k_2 p_1 p_2 0 alpha_s"},
                {"pinhole-radtan+skew", "radtan", "k_1 k_2 p_1 p_2 k_3 alpha_s"}},
      .first_pixel = kMatlabPixel};
  return kTable;
}

bool IsFisheye(const CalibratedCamera& camera) {
  return camera.model->name.starts_with("scaramuzza") || camera.model->name.starts_with("division");
}

ImageSize SizeOfArgument(const std::vector<double>& rows_columns, const std::string& where) {
  constexpr double kMost = 1e6;  // no image has more rows
  for (const double length : rows_columns) {
    if (length >= 1 && length < kMost && length == std::floor(length)) continue;
    throw InputError("{}: ImageSize: expected a number of pixels, found {}", where, length);
  }
  return {static_cast<int>(rows_columns[1]), static_cast<int>(rows_columns[0])};
}

}  // namespace

std::vector<MatlabArgument> ToMatlab(const CalibratedCamera& camera) {
  const MatlabArgument size{
      "ImageSize",
      1,
      {static_cast<double>(camera.image_size[1]), static_cast<double>(camera.image_size[0])}};
  if (IsFisheye(camera)) {
    const StretchedFisheye f = ToStretched(camera, "matlab", /*unit=*/1);
    return {{kMatlabFisheye, 1, {f.a.begin(), f.a.end()}},
            size,
            {"DistortionCenter", 1, {f.centre.x() + kMatlabPixel, f.centre.y() + kMatlabPixel}},
            {"StretchMatrix", 2, {f.stretch.data(), f.stretch.data() + 4}}};
  }
  const Lens lens = ToLens(camera, MatlabLenses());
  const std::vector<double>& k = lens.coefficients;
  return {{"FocalLength", 1, {lens.f_x, lens.f_y}},
          {"PrincipalPoint", 1, {lens.c_x, lens.c_y}},
          size,
          {"RadialDistortion", 1, {k[0], k[1], k[4]}},
          {"TangentialDistortion", 1, {k[2], k[3]}},
          {"Skew", 1, {k[5] * lens.f_x}}};
}

CalibratedCamera FromMatlab(const ReadMatlabArgument& read,
                            bool is_fisheye,
                            const std::string& where) {
  const ImageSize size = SizeOfArgument(read("ImageSize", 2, 2), where);
  if (is_fisheye) {
    const std::vector<double> a = read(kMatlabFisheye, 4, 4);
    const std::vector<double> centre = read("DistortionCenter", 2, 2);
    const std::vector<double> stretch = read("StretchMatrix", 4, 4);
    return FromStretched({{a[0], a[1], a[2], a[3]},
                          Eigen::Map<const Eigen::Matrix2d>(stretch.data()),
                          {centre[0] - kMatlabPixel, centre[1] - kMatlabPixel}},
                         size,
                         where);
  }
  const std::vector<double> f = read("FocalLength", 2, 2), c = read("PrincipalPoint", 2, 2);
  std::vector<double> radial = read("RadialDistortion", 2, 3);
  radial.resize(3);
  const std::vector<double> tangential = read("TangentialDistortion", 2, 2);
  const double skew = read("Skew", 1, 1)[0] / f[0];
  return FromLens({"radtan",
                   f[0],
                   f[1],
                   c[0],
                   c[1],
                   {radial[0], radial[1], tangential[0], tangential[1], radial[2], skew}},
                  size,
                  MatlabLenses(),
                  where);
}

}  // namespace plenocal
