// SPDX-License-Identifier: Apache-2.0
#include "models/formula/defects.h"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

namespace plenocal::formula {
namespace {

// Values of nodes on the axis.
std::vector<double> OnAxis(
    const Graph& graph, const std::vector<int>& nodes, Form form, size_t varying, const double* k) {
  std::array<double, 3 * kBlock> inputs{};
  if (form == Form::kMap) inputs[2 * kBlock] = 1;
  const Tape tape(graph, nodes, varying);
  const auto values = tape.Evaluate(inputs.data(), k, 1);
  std::vector<double> result;
  for (size_t i = 0; i < nodes.size(); ++i) result.push_back(values[i][0]);
  return result;
}

bool AllFinite(const std::vector<double>& values) {
  return std::ranges::all_of(values, [](double value) { return std::isfinite(value); });
}

// Directions around the axis, none of them special.
void PutGenericDirections(LensBlock* block) {
  block->count = kBlock;
  for (size_t i = 0; i < kBlock; ++i) {
    const double part = static_cast<double>(i + 1) / kBlock, azimuth = 2.4 * static_cast<double>(i);
    const double radius = 0.4 * part * part;
    block->p[i] = radius * std::cos(azimuth);
    block->p[kBlock + i] = radius * std::sin(azimuth);
    block->p[2 * kBlock + i] = 1;
  }
}

// The example, with no parameter at a special value.
std::vector<double> GenericParams(std::span<const Param> params, std::span<const double> example) {
  std::vector<double> k(example.begin(), example.end());
  for (size_t i = 0; i < k.size(); ++i) {
    const double step = 0.01 * params[i].scale * (1 + 0.3 * static_cast<double>(i % 4));
    k[i] = k[i] + step < params[i].upper ? k[i] + step : (k[i] + params[i].upper) / 2;
  }
  return k;
}

// Names of parameters whose effects together replace each other at all points of a block with
// derivatives, those of f_x, f_y, c_x, c_y included; empty when there are none.
std::vector<std::string> NamesOfOneEffect(const LensBlock& block, std::span<const Param> params) {
  constexpr double kRounding = 1e-13, kMatters = 1e-3;
  std::vector<std::string> names{"f_x", "f_y", "c_x", "c_y"};
  for (const Param& param : params) names.emplace_back(param.name);
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(2 * kBlock, std::ssize(names));
  for (size_t i = 0; i < kBlock; ++i) {
    if (!block.inside[i]) continue;
    const auto at = static_cast<Eigen::Index>(2 * i);
    for (Eigen::Index row = 0; row < 2; ++row) {
      const auto of = static_cast<size_t>(row);
      J(at + row, row) = block.m[of * kBlock + i];
      J(at + row, 2 + row) = 1;
      for (size_t j = 0; j < params.size(); ++j) {
        J(at + row, static_cast<Eigen::Index>(4 + j)) =
            block.by_k[(of * params.size() + j) * kBlock + i];
      }
    }
  }
  J.colwise().normalize();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(J, Eigen::ComputeThinV);
  std::vector<std::string> same;
  if (!(svd.singularValues().tail<1>()[0] < kRounding * svd.singularValues()[0])) return same;
  for (size_t k = 0; k < names.size(); ++k) {
    if (std::abs(svd.matrixV()(static_cast<Eigen::Index>(k), J.cols() - 1)) > kMatters) {
      same.push_back(names[k]);
    }
  }
  return same;
}

}  // namespace

std::string DefectOnAxis(LensNodes nodes, const double* example) {
  Graph& graph = nodes.graph;
  const size_t varying = nodes.Varying();
  const auto on_axis = [&](const std::vector<int>& of) {
    return OnAxis(graph, of, nodes.form, varying, example);
  };
  const std::vector<bool> needed = Needed(graph, nodes.outputs);
  std::vector<int> calls;  // in the order of the formula
  for (const auto& [node, text] : graph.Texts()) {
    if (needed[static_cast<size_t>(node)]) calls.push_back(node);
  }
  const std::vector<double> values = on_axis(nodes.outputs);
  if (!AllFinite(values)) {
    for (const int call : calls) {
      if (AllFinite(on_axis({call}))) continue;
      return fmt::format("'{}' is not finite on the optical axis at the example",
                         graph.Texts().at(call));
    }
    return "is not finite on the optical axis at the example: a division by 0";
  }
  for (const int condition : nodes.conditions) {
    if (on_axis({condition})[0] == 0)
      return "the domain does not hold the optical axis at the example";
  }
  const auto slopes = [&](const std::vector<int>& of) {
    return on_axis(DerivativesBy(&graph, of, 0, varying));
  };
  const std::vector<double> slope = slopes(nodes.outputs);
  if (!AllFinite(slope)) {
    const auto culprit =
        std::ranges::find_if(calls, [&](int call) { return !AllFinite(slopes({call})); });
    return fmt::format(
        "{} has no derivative at X = Y = 0; use angle_over_radius or sinc",
        culprit == calls.end() ? "the formula" : "'" + graph.Texts().at(*culprit) + "'");
  }
  if (nodes.form == Form::kRadius && values[0] != 0) {
    return fmt::format("the radius is {:.3g} on the optical axis and must be 0", values[0]);
  }
  if (nodes.form == Form::kRadius && !(slope[0] > 0)) {
    return fmt::format(
        "the radius does not grow from the optical axis at the example (its slope is "
        "{:.3g}); change the sign or the example",
        slope[0]);
  }
  if (nodes.form == Form::kRay && !(values[2] > 0)) {
    return "the ray of x = y = 0 does not look forward; its third coordinate must be above 0";
  }
  return "";
}

std::string DefectAround(const LensFormula& lens,
                         Form form,
                         std::span<const Param> params,
                         std::span<const double> example) {
  LensBlock block;
  PutGenericDirections(&block);
  std::vector<double> by_k(2 * params.size() * kBlock);
  block.by_k = by_k.data();
  lens.Map(example.data(), Need::kAll, &block);
  if (std::ranges::none_of(block.inside, [](bool inside) { return inside; })) {
    return "the domain is empty around the optical axis at the example";
  }
  constexpr double kEuler = 1e-9;
  for (size_t i = 0; form == Form::kMap && i < kBlock; ++i) {
    if (!block.inside[i]) continue;
    for (size_t row = 0; row < 2; ++row) {
      double along = 0, size = 0;
      for (size_t j = 0; j < 3; ++j) {
        const double slope = block.by_p[(3 * row + j) * kBlock + i];
        along += slope * block.p[j * kBlock + i];
        size += std::abs(slope);
      }
      if (std::abs(along) > kEuler * size) {
        return "the map changes along a ray: it must depend on the direction only, as X / Z does";
      }
    }
  }
  lens.Map(GenericParams(params, example).data(), Need::kAll, &block);
  for (size_t j = 0; j < params.size(); ++j) {
    bool has_effect = std::ranges::none_of(block.inside, [](bool inside) { return inside; });
    for (size_t i = 0; i < kBlock; ++i) {
      const double change =
          std::abs(by_k[j * kBlock + i]) + std::abs(by_k[(params.size() + j) * kBlock + i]);
      has_effect = has_effect || (block.inside[i] && change > 0);
    }
    if (!has_effect) return fmt::format("parameter '{}' has no effect; remove it", params[j].name);
  }
  const std::vector<std::string> same = NamesOfOneEffect(block, params);
  if (!same.empty()) {
    return fmt::format("changes of '{}' replace each other in all images; remove one of them",
                       fmt::join(same, "', '"));
  }
  return "";
}

}  // namespace plenocal::formula
