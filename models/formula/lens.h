// SPDX-License-Identifier: Apache-2.0
//
// The lens of a formula: directions to lens coordinates in the plane at distance 1, and back.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "models/formula/graph.h"
#include "models/formula/tape.h"

namespace plenocal::formula {

enum class Form {
  kMap,     ///< (m_x, m_y) of X, Y, Z
  kRadius,  ///< |m| of the angle off the axis or of r = sqrt(X^2 + Y^2) / Z
  kRay,     ///< the direction of m = (x, y)
};

/// A formula as nodes. The inputs are X Y Z, or the radius' variable, or x y, then the parameters.
struct LensNodes {
  Form form = Form::kMap;
  Graph graph = {};
  std::vector<int> outputs = {}, conditions = {};
  std::vector<int> unmap = {};  ///< of kMap: inputs x, y, one without use, the parameters; or empty
  size_t param_count = 0;
  bool of_angle = true;  ///< kRadius

  [[nodiscard]] size_t Varying() const {
    return form == Form::kMap ? 3 : form == Form::kRadius ? 1 : 2;
  }
};

/// What a call needs beside m.
enum class Need { kValue, kPoint, kAll };

/// Points and their images; number j of point i is at j * kBlock + i.
struct LensBlock {
  size_t count = 0;
  std::array<double, 3 * kBlock> p;  ///< of largest coordinate 1
  std::array<double, 2 * kBlock> m;
  std::array<double, 6 * kBlock> by_p;
  double* by_k = nullptr;           ///< 2 x parameters, for Need::kAll
  std::array<bool, kBlock> inside;  ///< false: outside the domain, m has no meaning
};

class LensFormula {
 public:
  virtual ~LensFormula() = default;
  virtual void Map(const double* k, Need need, LensBlock* block) const = 0;
  /// A direction of any length.
  [[nodiscard]] virtual std::optional<Eigen::Vector3d> Unmap(const double* k,
                                                             const Eigen::Vector2d& m) const = 0;
};

std::unique_ptr<LensFormula> MakeLens(LensNodes nodes);

/// Nodes with the derivatives by the inputs `begin` to `end`, output by output.
std::vector<int> DerivativesBy(Graph* graph,
                               const std::vector<int>& outputs,
                               size_t begin,
                               size_t end);

}  // namespace plenocal::formula
