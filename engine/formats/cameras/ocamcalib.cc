// SPDX-License-Identifier: Apache-2.0
//
// calib_results.txt of OCamCalib: numbers in a fixed order between comments. Its x is our y (rows),
// its y our x, and its camera looks along -z. cam2world with `pol` is the model; `invpol` of
// world2cam is a fit to it, which is not read.
//
// Source: Scaramuzza, OCamCalib, ocam_functions.c and export_data.m:
//
//   row = c x + d y + row_0,  column = e x + y + column_0,  direction (x, y, pol(rho)), pol_0 < 0
//
// where (0, 0) is the centre of the first pixel.
#include <fmt/format.h>

#include <Eigen/QR>
#include <array>
#include <cmath>

#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lenses/stretched_fisheye.h"
#include "engine/formats/word_lines.h"

namespace plenocal {
namespace {

/// `invpol`, lowest power first: the radius by atan(z / rho) of its frame, and the largest error of
/// the fit, px.
struct InversePolynomial {
  std::vector<double> coefficients;
  double error = 0;
};

InversePolynomial FitInverse(const std::array<double, 4>& a, double largest_radius) {
  constexpr int kSamples = 200, kMostPower = 14;
  constexpr double kEnough = 0.01;  // px, as findinvpoly.m
  Eigen::VectorXd angle(kSamples), radius(kSamples);
  for (int i = 0; i < kSamples; ++i) {
    const double rho = largest_radius * i / (kSamples - 1);
    radius[i] = rho;
    angle[i] = std::atan2(-(a[0] + rho * rho * (a[1] + rho * (a[2] + rho * a[3]))), rho);
  }
  InversePolynomial inverse;
  for (int power = 4; power <= kMostPower; ++power) {
    Eigen::MatrixXd powers(kSamples, power + 1);
    powers.col(0).setOnes();
    for (int k = 1; k <= power; ++k) powers.col(k) = powers.col(k - 1).cwiseProduct(angle);
    const Eigen::VectorXd solved = powers.householderQr().solve(radius);
    inverse = {{solved.begin(), solved.end()}, (powers * solved - radius).cwiseAbs().maxCoeff()};
    if (inverse.error < kEnough) break;
  }
  return inverse;
}

std::string WriteOcamcalib(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  const StretchedFisheye f = ToStretched(camera, "ocamcalib", /*unit=*/0);
  const auto [width, height] = camera.image_size;
  const double corner = std::hypot(std::max(f.centre.x(), width - f.centre.x()),
                                   std::max(f.centre.y(), height - f.centre.y()) / f.stretch(1, 1));
  const InversePolynomial inverse = FitInverse(f.a, corner);
  return fmt::format(
      "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). These are "
      "used by cam2world\n\n5 {}\n\n"
      "#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). "
      "These are used by world2cam; a fit to {:.1g} px\n\n{} {}\n\n"
      "#center: \"row\" and \"column\", starting from 0 (C convention)\n\n{}\n\n"
      "#affine parameters \"c\", \"d\", \"e\"\n\n{}\n\n"
      "#image size: \"height\" and \"width\"\n\n{} {}\n\n",
      BlankSeparated(std::array{-f.a[0], 0.0, -f.a[1], -f.a[2], -f.a[3]}),
      inverse.error,
      inverse.coefficients.size(),
      BlankSeparated(inverse.coefficients),
      BlankSeparated(std::array{f.centre.y(), f.centre.x()}),
      BlankSeparated(std::array{f.stretch(1, 1), f.stretch(1, 0), f.stretch(0, 1)}),
      height,
      width);
}

std::vector<CalibratedCamera> ReadOcamcalib(const CameraSource& source) {
  const std::vector<WordLine> lines = ReadWordLines(source.path);
  if (lines.size() != 5) {
    lines[0].Fail("expected five lines of numbers: pol, invpol, centre, c d e, height and width");
  }
  const auto numbers = [&](size_t line, size_t count) {
    std::vector<double> values = lines[line].NumbersFrom(0);
    if (values.size() != count) lines[line].Fail(fmt::format("expected {} numbers", count));
    return values;
  };
  std::vector<double> pol = lines[0].NumbersFrom(1);
  if (pol.size() != lines[0].Count(0)) lines[0].Fail("expected as many coefficients as it states");
  for (size_t i = 0; i < pol.size(); ++i) {
    if ((i == 1 || i > 4) && pol[i] != 0) {
      lines[0].Fail(fmt::format("the coefficient of rho^{} is not 0: not read", i));
    }
  }
  pol.resize(5);
  const std::vector<double> centre = numbers(2, 2), affine = numbers(3, 3);
  StretchedFisheye fisheye{{-pol[0], -pol[2], -pol[3], -pol[4]}, {}, {centre[1], centre[0]}};
  fisheye.stretch << 1, affine[2], affine[1], affine[0];
  return {FromStretched(fisheye, {lines[4].Pixels(1), lines[4].Pixels(0)}, lines[0].where)};
}

}  // namespace

CameraFormat OcamcalibFormat() {
  return {.name = "ocamcalib",
          .file = "calib_results.txt",
          .write = WriteOcamcalib,
          .read = ReadOcamcalib};
}

}  // namespace plenocal
