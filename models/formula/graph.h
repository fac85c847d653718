// SPDX-License-Identifier: Apache-2.0
//
// Expressions of a formula as a graph in which equal sub-expressions are one node.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "models/formula/operations.h"

namespace plenocal::formula {

struct Node {
  Op op = Op::kConstant;
  std::array<int, 3> of = {-1, -1, -1};  ///< operands, -1: none; kInput: the input's number first
  double value = 0;                      ///< of kConstant
};

/// Nodes in an order in which operands come first. Constants are folded.
class Graph {
 public:
  int Constant(double value);
  int Input(int number);
  int Make(Op op, int a, int b = -1, int c = -1);
  int Power(int base, int exponent);

  [[nodiscard]] const Node& operator[](int node) const { return nodes_[static_cast<size_t>(node)]; }
  [[nodiscard]] int Size() const { return static_cast<int>(nodes_.size()); }
  [[nodiscard]] bool Is(int node, double value) const;

  /// Text from which a node was made, for messages; the first counts.
  void Remember(int node, std::string_view text) { texts_.emplace(node, text); }
  [[nodiscard]] const std::map<int, std::string>& Texts() const { return texts_; }

  /// Throws `Error` when the graph grows beyond it.
  void Limit(int nodes) { limit_ = nodes; }

 private:
  int Add(const Node& node);
  // The node that an operation with 0 or 1 is equal to, or -1.
  [[nodiscard]] int Simpler(Op op, int a, int b);

  std::vector<Node> nodes_;
  std::map<std::tuple<Op, int, int, int, uint64_t>, int> known_;
  std::map<int, std::string> texts_;
  int limit_ = 4096;
};

/// For each node whether one of `outputs` depends on it.
std::vector<bool> Needed(const Graph& graph, std::span<const int> outputs);

}  // namespace plenocal::formula
