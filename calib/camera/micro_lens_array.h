// SPDX-License-Identifier: Apache-2.0
//
// The micro-lens array of a plenoptic camera with the errors of its centres, and their files.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/lens_lattice.h"
#include "calib/camera/observation.h"

namespace plenocal {

struct CameraModel;

/// One micro lens as raw images show it.
struct MicroLens {
  int row = 0, column = 0;  ///< in the lattice: neighbours along e_column differ by 1 in `column`
  /// Micro-image centre in the raw, distorted image, px, (0, 0) at the centre of the top-left
  /// pixel.
  Eigen::Vector2d centre{0, 0};
  int type = 0;        ///< 0 .. types - 1; the order means nothing
  bool usable = true;  ///< false for a dead or dirty micro lens
};

/// Errors of a lattice's places: in x, and independently in y, a polynomial of the place in the
/// raw image.
struct LatticeErrors {
  ImageSize image_size{};
  /// Of the polynomial's coefficients, px^2: a symmetric matrix; empty: not known.
  std::vector<double> covariance = {};

  [[nodiscard]] bool AreKnown() const { return !covariance.empty(); }
  [[nodiscard]] Eigen::MatrixXd Covariance() const;
  /// L with L L' the covariance, a row per coefficient.
  [[nodiscard]] Eigen::MatrixXd Root() const;
  /// The polynomial's terms, to which the rows of the root belong, at a place.
  [[nodiscard]] Eigen::VectorXd Terms(const Eigen::Vector2d& position) const;
};

/// Lens types that an array may have: the sets of micro lenses that a rectangular lattice
/// interleaves.
inline constexpr int kMostLensTypes = 4;

/// The micro-lens array of a plenoptic camera: all micro lenses whose micro-image centre lies on
/// the sensor. Plain data, so that camera models and the pipeline share it.
struct MicroLensArray {
  ImageSize image_size{};
  int types = 1;
  /// Lattice vectors at the middle of the image, px: to the next micro lens in a row, and to the
  /// next row. Hexagonal: |e_column| = |e_row|, 60 degrees apart; rectangular: 90 degrees. Lens
  /// distortion changes them slowly.
  Eigen::Vector2d e_column{0, 0}, e_row{0, 0};
  std::vector<MicroLens> lenses;
  LatticeErrors errors = {};  ///< of the centres

  /// Arrangement of the micro lenses.
  [[nodiscard]] LatticeKind Lattice() const;
  /// Mean distance of neighbours at the middle of the image, px.
  [[nodiscard]] double Pitch() const { return (e_column.norm() + e_row.norm()) / 2; }
};

/// True where the array's tilt against the sensor is among a model's parameters.
bool HasTilt(const CameraModel& model);

/// Sets the lattice vectors from rows, columns and centres. Returns the lattice fitted to them.
/// Throws `Error` for too few micro lenses.
SmoothLattice SetLatticeVectors(MicroLensArray* array);

/// Numbers the types from 0 without gaps, in the order of their numbers, and counts them. Returns
/// the first micro lens of a type too many, if there is one: at most `kMostLensTypes` are kept.
std::optional<size_t> NumberLensTypes(MicroLensArray* array);

/// The text of micro_lenses_<camera>.csv: index, x, y, type, then row, column, usable.
std::string FormatMicroLenses(const MicroLensArray& array);

/// Reads such a file; `row`, `column` and `usable` may be missing (other programs' files: index, x,
/// y, type), then the lattice is found from the centres. Types are numbered as by
/// `NumberLensTypes`. Throws `Error` of kind kInput with file and line.
MicroLensArray ReadMicroLenses(const std::filesystem::path& path, ImageSize image_size);

/// Errors of a fit to measured places. Neighbours may share errors: the variance of a measurement
/// is that by the means of blocks of 5 x 5 nodes where these scatter more than the residuals
/// explain. Fewer than 60 measurements do not show it: then the errors of a nominal grid.
LatticeErrors ErrorsOfFit(const SmoothLattice& lattice,
                          std::span<const LatticeMeasurement> measurements,
                          ImageSize image_size);

/// Errors of a grid that states none, as RayCalibData: standard deviations of 0.1 px in its offset,
/// 1e-4 in scale and shear, 1e-4 rad in rotation.
LatticeErrors ErrorsOfNominalGrid(ImageSize image_size);

/// The text of lattice_<camera>.yaml; empty for errors that are not known.
std::string FormatLatticeErrors(const LatticeErrors& errors);

/// Reads such a file. Throws `Error` of kind kInput with the place for one without a covariance, or
/// of images of another size.
LatticeErrors ReadLatticeErrors(const std::filesystem::path& path, ImageSize image_size);

}  // namespace plenocal
