// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/lenses/stretched_fisheye.h"

#include <cmath>

#include "calib/base/format_error.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"

namespace plenocal {
namespace {

LensTable ScaramuzzaLenses(std::string_view tool) {
  return {tool,
          {{"scaramuzza", "scaramuzza", "b_2 b_3 b_4 0"},
           {"scaramuzza+skew", "scaramuzza", "b_2 b_3 b_4 alpha_s"},
           {"division", "scaramuzza", "lambda 0 0 0"},
           {"division+skew", "scaramuzza", "lambda 0 0 alpha_s"}}};
}

}  // namespace

CalibratedCamera FromStretched(const StretchedFisheye& fisheye,
                               ImageSize image_size,
                               const std::string& where) {
  const double a_0 = fisheye.a[0];
  if (!(a_0 > 0)) throw InputError("{}: the polynomial looks backwards at radius 0", where);
  if (!(fisheye.stretch.determinant() > 0)) throw InputError("{}: the stretch mirrors", where);
  // The stretch is an upper triangle times a rotation, with which the radial lens commutes.
  const double e = fisheye.stretch(1, 0), d = fisheye.stretch(1, 1);
  const double phi = std::atan2(e, d);
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  if (e != 0 || !(d > 0)) {
    turn.topLeftCorner<2, 2>() << std::cos(phi), -std::sin(phi), std::sin(phi), std::cos(phi);
  }
  const Eigen::Matrix2d triangle = fisheye.stretch * turn.topLeftCorner<2, 2>().transpose();
  const double f_x = a_0 * triangle(0, 0);
  CalibratedCamera camera = FromLens({"scaramuzza",
                                      f_x,
                                      a_0 * triangle(1, 1),
                                      fisheye.centre.x(),
                                      fisheye.centre.y(),
                                      {fisheye.a[1] * a_0,
                                       fisheye.a[2] * a_0 * a_0,
                                       fisheye.a[3] * a_0 * a_0 * a_0,
                                       triangle(0, 1) / triangle(0, 0)}},
                                     image_size,
                                     ScaramuzzaLenses("scaramuzza"),
                                     where);
  camera.T_camera_rig.R = turn;
  return camera;
}

StretchedFisheye ToStretched(const CalibratedCamera& camera,
                             std::string_view tool,
                             Eigen::Index unit) {
  const Lens lens = ToLens(camera, ScaramuzzaLenses(tool));
  StretchedFisheye fisheye;
  const double a_0 = unit == 0 ? lens.f_x : lens.f_y;
  fisheye.stretch(0, 0) = lens.f_x / a_0;
  fisheye.stretch(1, 1) = lens.f_y / a_0;
  fisheye.stretch(0, 1) = lens.coefficients[3] * fisheye.stretch(0, 0);
  fisheye.centre = {lens.c_x, lens.c_y};
  fisheye.a[0] = a_0;
  double power = 1;
  for (size_t i = 1; i < fisheye.a.size(); ++i) {
    const double b = lens.coefficients[i - 1];
    power *= a_0;
    fisheye.a[i] = Inverted(b, b / power, [&](double x) {
      for (size_t k = 0; k < i; ++k) x *= a_0;
      return x;
    });
  }
  return fisheye;
}

}  // namespace plenocal
