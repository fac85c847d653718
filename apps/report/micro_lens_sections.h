// SPDX-License-Identifier: Apache-2.0
//
// Makes data of the report from the micro lenses of a camera.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "assess/views/micro_lens_visibility.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// The micro lenses of one camera, from micro_lenses_<camera>.csv.
class MicroLensTable {
 public:
  /// `name` stands for the file in messages.
  MicroLensTable(const std::string& csv, const std::string& name);

  /// Type of the micro lens that each row of the residuals was seen through; -1: not in the table.
  [[nodiscard]] std::vector<int> TypesOf(const CalibratedCamera& camera) const;
  /// Where its micro images show points. REQUIRES: `HasLattice`.
  [[nodiscard]] MicroLensVisibility Visibility(ImageSize image_size) const;
  /// Whether it has rows and columns, and enough micro lenses.
  [[nodiscard]] bool HasLattice() const;
  /// `MicroLenses` of the schema: deviations of the micro-image centres from a regular lattice
  /// fitted to them. Null when the file has no rows and columns.
  [[nodiscard]] nlohmann::json GridSection(ImageSize image_size) const;

 private:
  struct Lens {
    Eigen::Vector2d centre;
    int type, row, column;
  };
  /// centre = offset + column * e_column + row * e_row: 3 x 2, one of these a row.
  [[nodiscard]] Eigen::MatrixXd Lattice(Eigen::MatrixXd* off) const;

  std::vector<Lens> lenses_;
  bool has_lattice_ = false;
};

}  // namespace plenocal
